"""Range sensors: what they measure, when, and with which errors."""

from __future__ import annotations

import copy
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from omegaconf import OmegaConf

from auvbench.cli import main
from auvbench.config.compose import compose, typed
from auvbench.config.ranges import GRADIANS, NAMES, Ping360
from auvbench.dynamics.frames import rotation
from auvbench.envs.batch import Batch
from auvbench.envs.settings import configuration
from auvbench.errors import ConfigError
from auvbench.evaluation.protocol import fingerprint, resolve_conditions
from auvbench.pilot import live_observation as observation
from auvbench.registry import BLOCKS
from auvbench.runs import identity
from auvbench.testing import blocks as conformance
from auvbench.worlds.casting import cast
from tests import configs

Floats = NDArray[np.float64]
TANK = ("world=tank", "world.length=24", "world.width=20", "world.depth=26", "task.start_high=5")


def batch(*words: str, n: int = 3, world: tuple[str, ...] = TANK, **own: Any) -> Batch:
    """Return environments whose agents observe all sensors, so that one loop is compiled; `words` change keys."""
    seen = ",".join(f"range.{name}" for name in NAMES)
    chosen = [
        "task=docking",
        "vehicle=bluerov2_2026",
        "algo=pid",
        f"task.observation=[position_error,{seen}]",
    ]
    keys = [f"task.range.{word}" if word.partition(".")[0] in NAMES else word for word in words]
    return Batch(configuration(overrides=[*chosen, *world, *keys]), n, **own)


def actions(one: Batch, step: int) -> Floats:
    """Return commands (n, n_u) that turn and tilt the vehicles."""
    turn = 7 * (step // 10) + 5 * np.arange(one.n)[:, None] + 3 * np.arange(len(one.vehicle.actuators))
    return (turn % 17 - 8) / 16.0


def play(one: Batch, steps: int) -> Floats:
    """Return the observations (steps + 1, n, size) of a play."""
    return np.array(
        [one.reset().copy(), *(one.step(actions(one, k)).observation.copy() for k in range(steps))]
    )


def part(one: Batch, seen: Any, name: str) -> Any:
    """Return the numbers of a sensor."""
    return seen[..., one.task.spec[f"range.{name}"]]


def measured(one: Batch, rays: Floats, i: int, high: float, time: float = 0.0) -> Floats:
    """Return the distances in m along rays (k, 3) of body axes from vehicle i."""
    assert one.task.world is not None
    pose = one.simulator.pose[i]
    world = np.ascontiguousarray(rays @ rotation(pose[3:]).T)
    ranges, hits = np.empty(len(rays)), np.empty(len(rays), np.int64)
    solids = one.task.world.solids[i, : one.task.episodes[i].solids]
    cast(solids, one.task.world.heights, time, np.tile(pose[:3], (len(rays), 1)), world, high, ranges, hits)
    return ranges


# --- What they measure --------------------------------------------------------------------------------------------------------------


def test_ideal_rays_are_those_of_gym_dockauv_and_show_how_close_a_wall_is() -> None:
    one = batch()
    seen = part(one, play(one, 25), "ideal")
    assert seen.shape[-1] == 63
    azimuths, elevations = np.radians(np.arange(40, -41, -10)), np.radians(np.arange(-30, 31, 10))
    down, across = np.meshgrid(elevations, azimuths, indexing="ij")
    level = np.cos(down)
    rays = np.stack([level * np.cos(across), level * np.sin(across), np.sin(down)], -1).reshape(-1, 3)
    for i in range(one.n):
        x, y, z = one.simulator.pose[i, :3]
        way = rays @ rotation(one.simulator.pose[i, 3:]).T
        # To the walls and the bottom of the tank, by hand.
        walls = [((12.0 * np.sign(way[:, 0]) - x) / way[:, 0]), ((10.0 * np.sign(way[:, 1]) - y) / way[:, 1])]
        bottom = np.where(way[:, 2] < 0.0, (-26.0 - z) / way[:, 2], np.inf)
        distance = np.min([*walls, bottom], axis=0)
        np.testing.assert_allclose(seen[-1, i], 1.0 - np.minimum(distance, 10.0) / 10.0, atol=2e-6)
    assert 0.1 < (seen[-1] > 0.0).mean() < 1.0


def test_rays_meet_a_solid_that_moves_where_it_is_now() -> None:
    one = batch()
    one.reset()
    assert one.task.world is not None
    assert one.task.sensors is not None
    one.task.world.solids["velocity"] = 0.5 * one.task.world.solids["along_z"]  # bottom and walls come nearer
    for step in range(40):
        seen = part(one, one.step(actions(one, step)).observation, "ideal")
    (rays,) = (sensor.rays for sensor in one.task.sensors.sensors if sensor.name == "range.ideal")
    for i in range(one.n):
        now, then = (measured(one, rays, i, 10.0, time) for time in (4.0, 0.0))
        assert seen[i] == pytest.approx(1.0 - now / 10.0, abs=2e-6)
    assert (now < then - 0.5).any()


def test_an_echo_sounder_gives_the_nearest_echo_in_its_cone() -> None:
    still = ("ping1d.noise=0", "ping1d.dropout=0", "ping1d.jumps=0", "ping1d.beam=0.8")
    slope = ("world=slope", "world.dip=0.6", "world.direction=0", "world.altitude=9")
    one = batch(*still, world=slope)
    distance, confidence, age = part(one, one.reset(), "ping1d").T
    for i in range(one.n):
        assert one.task.world is not None
        bottom = one.task.world.solids[i, 0]
        above = float((one.simulator.pose[i, :3] - bottom["position"]) @ bottom["along_z"])
        # The cone reaches to 0.4 rad from the vertical, the nearest point of the slope is at 0.6 rad.
        nearest = above / math.cos(0.6 - 0.4)
        assert nearest <= distance[i] * (1.0 + 1e-6)
        assert distance[i] < 1.03 * nearest
        assert distance[i] < 0.95 * above / math.cos(0.6)  # that along the axis
    assert (confidence > 0.0).all()
    assert (age == 0.0).all()


def test_pings_have_the_confidence_noise_and_jumps_of_the_recordings() -> None:
    one = batch("task.time_limit=1000", "task.bounds=1000", n=400, seed=5)
    one.reset()
    still = np.zeros_like(one._action)
    rows: list[tuple[Floats, Floats]] = []
    for _ in range(50):
        seen = part(one, one.step(still).observation, "ping1d").copy()
        true = [measured(one, np.array([[0.0, 0.0, -1.0]]), i, 100.0)[0] for i in range(0, one.n, 8)]
        rows.append((seen[::8], np.array(true)))
    distance, confidence, _ = np.concatenate([seen for seen, _ in rows]).T
    real = np.concatenate([true for _, true in rows])
    assert (confidence == 0.0).mean() == pytest.approx(0.06, abs=0.015)
    assert (confidence < 0.5).mean() == pytest.approx(0.14, abs=0.02)
    assert (confidence == 1.0).mean() == pytest.approx(0.81, abs=0.025)
    error = distance - real
    sure = confidence >= 0.8
    assert np.median(np.abs(error[sure])) == pytest.approx(0.674 * 0.002, rel=0.15)
    jumps = np.abs(error) > 1.0
    assert 0.004 < jumps.mean() < 0.03  # a lost ping repeats a jump, and a small jump is none
    assert jumps[sure].mean() < 0.006


def test_a_lost_ping_repeats_the_last_distance_and_a_failed_sensor_has_none() -> None:
    one = batch("ping1d.dropout=0.5", "ping1d.jumps=0")
    seen = part(one, play(one, 40), "ping1d")
    lost = seen[1:, :, 1] == 0.0
    assert 0.3 < lost.mean() < 0.7
    assert (seen[1:, :, 0][lost] == seen[:-1, :, 0][lost]).all()
    failed = batch(*(f"{name}.dropout=1" for name in NAMES))
    seen = play(failed, 10)
    assert (part(failed, seen, "ping1d")[..., :2] == [100.0, 0.0]).all()
    assert (part(failed, seen, "ideal") == 0.0).all()
    assert (part(failed, seen, "ping360")[..., :-2] == 0.0).all()
    assert (part(failed, seen, "multibeam")[..., :-1] == 0.0).all()


def test_an_echo_nearer_than_the_shortest_range_shows_the_shortest_range() -> None:
    near = ("ping1d.low=6", "ping1d.noise=0", "ping1d.dropout=0", "ping1d.jumps=0")
    one = batch(*near, n=8)
    distance, confidence, _ = part(one, one.reset(), "ping1d").T
    below = one.simulator.pose[:, 2] + 26.0 < 6.0
    assert 0 < below.sum() < 8
    np.testing.assert_allclose(distance[below], 6.0)
    assert (confidence[below] == 0.0).all()
    assert (confidence[~below] == 1.0).all()


def test_a_multibeam_gives_the_nearest_echo_in_each_beam() -> None:
    one = batch("multibeam.beams=16")
    seen = part(one, play(one, 20), "multibeam")[-1]
    angles = np.radians(np.linspace(65.0, -65.0, 16 * 20 + 1))
    elevations = np.radians(np.linspace(-10.0, 10.0, 21))
    for i in range(one.n):
        down, across = np.meshgrid(elevations, angles, indexing="ij")
        rays = np.stack([np.cos(down) * np.cos(across), np.cos(down) * np.sin(across), np.sin(down)], -1)
        ranges = measured(one, rays.reshape(-1, 3), i, 30.0).reshape(rays.shape[:2])
        fine = [ranges[:, 20 * k : 20 * k + 21].min() for k in range(16)]
        coarse = 30.0 * (1.0 - seen[i, :-1].astype(float))
        assert (coarse >= np.array(fine) - 1e-4).all()
        np.testing.assert_allclose(coarse, fine, rtol=0.06)


# --- When they measure ------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("high", "step", "seconds"),
    [(2, 1, 10.7), (20, 1, 20.6), (50, 1, 37.6), (2, 10, 3.3), (20, 10, 4.2), (50, 10, 5.9)],
)
def test_a_turn_of_the_scanning_sonar_takes_the_time_that_users_measured(
    high: float, step: int, seconds: float
) -> None:
    composed = compose("train", ["algo=pid", "world=tank", "task.observation=[range.ping360]",
                                 f"task.range.ping360.high={high}", f"task.range.ping360.step={step}"])  # fmt: skip
    sensor: Ping360 = typed(composed).task.range.ping360
    assert sensor.beams * sensor.beam_time == pytest.approx(seconds, rel=0.03)
    assert sensor.beams == GRADIANS // step


def test_the_scanning_sonar_sees_a_sector_when_its_head_passes() -> None:
    words = ("ping360.high=30", "ping360.step=4", "ping360.sectors=20", "task.bounds=100")
    one = batch(*words, n=2)
    one.reset()
    sensor = one.config.task.range.ping360
    seen = np.zeros((2, 22))
    for step in range(1, 100):
        shown = part(one, one.step(actions(one, step)).observation, "ping360")
        beams = int(step * 0.1 / sensor.beam_time + 1e-9)
        before = int((step - 1) * 0.1 / sensor.beam_time + 1e-9)
        passed = {beam % 100 // 5 for beam in range(before, beams)}
        changed = set(np.flatnonzero((shown[:, :-2] != seen[:, :-2]).any(axis=0)).tolist())
        assert changed <= passed
        for i in range(2):
            for beam in range(before, beams):
                angle = (beam % 100 + 0.5) * math.radians(3.6) - math.pi
                pitch = np.radians([-12.5, -6.25, 0.0, 6.25, 12.5])
                rays = np.stack(
                    [np.cos(pitch) * math.cos(angle), np.cos(pitch) * math.sin(angle), np.sin(pitch)], 1
                )
                ranges = measured(one, rays, i, 30.0)
                assert shown[i, beam % 100 // 5] >= 1.0 - ranges.min() / 30.0 - 1e-6
        head = (beams % 100 + 0.5) * math.radians(3.6) - math.pi
        np.testing.assert_allclose(shown[:, -2:], [[math.cos(head), math.sin(head)]] * 2, atol=1e-6)
        seen = shown.copy()
    assert (seen[:, :-2] > 0.0).all()  # after two turns


def test_a_scan_of_a_sector_goes_to_and_fro() -> None:
    words = ("ping360.high=2", "ping360.step=10", "ping360.span=100", "ping360.sectors=10")
    one = batch(*words, n=1)
    seen = part(one, play(one, 40), "ping360")[:, 0]
    angles = np.degrees(np.arctan2(seen[:, -1], seen[:, -2]))
    assert angles.min() == pytest.approx(-40.5, abs=0.01)
    assert angles.max() == pytest.approx(40.5, abs=0.01)
    assert np.abs(np.diff(angles)).max() < 20.0  # never back at once


def test_a_sensor_keeps_its_numbers_between_pings_and_shows_their_age() -> None:
    one = batch("ping1d.rate=2", "ping1d.dropout=0", "multibeam.rate=2.5")
    seen = play(one, 40)
    pings, beams = part(one, seen, "ping1d"), part(one, seen, "multibeam")
    for step in range(41):
        np.testing.assert_allclose(pings[step, :, 2], 0.1 * (step % 5), atol=1e-6)
        np.testing.assert_allclose(beams[step, :, -1], 0.1 * (step % 4), atol=1e-6)
        if step % 5:
            assert (pings[step, :, :2] == pings[step - 1, :, :2]).all()
        if step % 4:
            assert (beams[step, :, :-1] == beams[step - 1, :, :-1]).all()
    assert (pings[5, :, 0] != pings[4, :, 0]).all()


@pytest.mark.parametrize("name", ["ping1d", "ping360", "multibeam"])
def test_a_delay_shifts_the_numbers(name: str) -> None:
    words = ("ping1d.dropout=0", "ping360.high=3")
    prompt = part(one := batch(*words), play(one, 30), name)
    late = part(one := batch(*words, f"{name}.delay=0.3"), play(one, 30), name)
    own = slice(0, None) if name == "ping360" else slice(0, -1)
    assert (late[3:, :, own] == prompt[:-3, :, own]).all()
    assert (late[:3, :, own] == prompt[0, :, own]).all()
    if name != "ping360":
        np.testing.assert_allclose(late[5:, :, -1], prompt[2:-3, :, -1] + 0.3, atol=1e-6)


def test_noise_has_its_deviation_and_its_own_draw_for_each_ray() -> None:
    words = ("ideal.noise=0.05", "ideal.high=40")
    clean, noisy = batch("ideal.high=40", n=40), batch(*words, n=40)
    error = 40.0 * (part(noisy, noisy.reset(), "ideal").astype(float) - part(clean, clean.reset(), "ideal"))
    echoes = np.abs(error) > 0.0
    assert error[echoes].std() == pytest.approx(0.05, rel=0.05)
    assert len(np.unique(error[echoes])) > 0.9 * echoes.sum()


# --- The same bits ------------------------------------------------------------------------------------------------------------------------

SMALL = (
    *("ideal.rows=2", "ideal.columns=3", "ideal.noise=0.02", "ideal.dropout=0.1"),
    *("ping1d.delay=0.25", "ping360.step=7", "ping360.sectors=12", "ping360.dropout=0.1"),
    *("multibeam.beams=6", "multibeam.rate=4", "multibeam.noise=0.03"),
)


def test_episodes_copies_and_resumed_environments_have_the_same_bits() -> None:
    first = batch(*SMALL, n=4, seed=3)
    together = play(first, 45)
    alone = play(batch(*SMALL, n=1, seed=3), 45)
    # Actions differ with the row only, of which row 0 is the first.
    np.testing.assert_array_equal(alone[:, 0], together[:, 0])
    resumed = batch(*SMALL, n=4, seed=99)
    resumed.load_state_dict(first.state_dict())
    others = [copy.deepcopy(first), pickle.loads(pickle.dumps(first)), resumed]
    for step in range(45, 80):
        seen = first.step(actions(first, step)).observation
        for other in others:
            np.testing.assert_array_equal(other.step(actions(first, step)).observation, seen)


@pytest.mark.slow
def test_threads_change_no_bit() -> None:
    many = batch(*SMALL, "simulator.threads=2", n=1024, seed=3)
    few = batch(*SMALL, "simulator.threads=1", n=1024, seed=3)
    np.testing.assert_array_equal(play(many, 3), play(few, 3))


def test_observing_again_changes_nothing() -> None:
    one = batch(*SMALL)
    play(one, 7)
    before = {name: value.tobytes() for name, value in one.task.state_dict().items()}
    one.task.observe(one.simulator.pose, one.simulator.velocity)
    assert before == {name: value.tobytes() for name, value in one.task.state_dict().items()}


@pytest.mark.slow
def test_they_keep_the_contract_of_blocks() -> None:
    words = [f"task.range.{word}" for word in SMALL]
    seen = ",".join(f"range.{name}" for name in NAMES)
    conformance.check_block("algo=pid", "world=tank", "task=waypoint_state", "vehicle=bluerov2_2026",
                            f"task.observation=[position_error,{seen}]", *words)  # fmt: skip


def test_a_stack_of_observations_begins_with_the_first() -> None:
    one = batch("task.history=2")
    seen = one.reset()
    half = seen.shape[1] // 2
    assert (seen[:, :half] == seen[:, half:]).all()
    first = seen[:, :half].copy()
    assert (one.step(actions(one, 0)).observation[:, half:] == first).all()


# --- The configuration -------------------------------------------------------------------------------------------------------------------


def frozen(*words: str) -> dict[str, Any]:
    plain: Any = OmegaConf.to_container(compose("train", ["algo=pid", *words]), resolve=True)
    return dict(plain)


def test_a_configuration_has_the_keys_of_the_sensors_that_it_observes() -> None:
    assert "range" not in frozen()["task"]
    assert identity.run_id(frozen()) == identity.run_id(frozen("task.range.ping1d.rate=3"))
    seen = ("world=tank", "task.observation=[range.ping1d]")
    own = frozen(*seen)
    assert [*own["task"]["range"]] == ["ping1d"]
    assert identity.run_id(own) == identity.run_id(frozen(*seen, "task.range.ping360.step=3"))
    assert identity.run_id(own) != identity.run_id(frozen(*seen, "task.range.ping1d.rate=3"))
    loaded = typed(OmegaConf.create(own)).task.range
    assert (loaded.ping1d.rate, loaded.ideal) == (15.0, None)


def test_all_sensors_are_blocks_of_the_registry() -> None:
    own = {*(f"range.{name}" for name in NAMES), "solids"}
    assert own == {name for name in BLOCKS.own if BLOCKS[name].sensor}
    assert not own & {*observation.supplied()}


def test_a_protocol_keeps_the_sensors_of_a_run_and_can_let_one_fail() -> None:
    seen = ("world=tank", "vehicle=bluerov2_2026", "task=docking")
    with_sensor = frozen(*seen, "task.observation=[position_error,range.ping1d]", "task.range.ping1d.rate=4")
    without = frozen(*seen)
    loss = 'protocol.overrides=["task=same","noise=thesis","task.range.ping1d.dropout=1"]'
    plain = configs.protocol("protocol=test", "protocol.episodes=3")
    failing = configs.protocol("protocol=test", "protocol.episodes=3", loss)
    (usual,), (failed,) = (resolve_conditions(protocol, with_sensor) for protocol in (plain, failing))
    assert (usual.config.task.range.ping1d.rate, usual.config.task.range.ping1d.dropout) == (4.0, 0.06)
    assert (failed.config.task.range.ping1d.rate, failed.config.task.range.ping1d.dropout) == (4.0, 1.0)
    (blind,) = resolve_conditions(failing, without)
    assert blind.config.task.range is None
    # Agents with and without the sensor meet the same scenarios.
    assert fingerprint(failing, [failed]) == fingerprint(failing, [blind])
    assert fingerprint(failing, [failed]) != fingerprint(plain, [usual])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["world=open"], r"range.ideal has nothing to measure in world=open; use world=\w+"),
        (["world=tank", "task.range.multibeam.high=100"], r"must be at most 7.5 Hz with task.range.multibeam.high=100"),
        (["world=tank", "task.range.ping1d.low=5", "task.range.ping1d.high=4"], "low=5: must be below"),
        (["world=tank", "task.range.ping360.sectors=50", "task.range.ping360.step=10"], "must be at most 40"),
        (["world=tank", "task.range.ideal.rows=0"], "task.range.ideal.rows=0: must be at least 1"),
        (["world=tank", "task.range.ping1d.dropout=2"], "task.range.ping1d.dropout=2: must be at least 0 and at most 1"),
        (["world=tank", "task.range.ping1d.beams=2"], "beams"),
        (["world=tank", "task.range=null"], "task.range"),
        (["world=tank", "task.observation=[range.ping2d]"], "range.ping1d"),
    ],
)  # fmt: skip
def test_wrong_sensors_are_refused(words: list[str], message: str) -> None:
    seen = ",".join(f"range.{name}" for name in NAMES)
    with pytest.raises(ConfigError, match=message) as error:
        configuration(overrides=[f"task.observation=[position_error,{seen}]", "algo=pid", *words])
    assert "\n" not in str(error.value)


def test_train_refuses_a_sensor_in_open_water(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ["algo=pid", "task.observation=[position_error,range.ping1d]", f"output={tmp_path}"]
    assert main(["train", *words]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert (
        "task.observation: range.ping1d has nothing to measure in world=open; use world=field or world=tank or"
        in line
    )
    assert not [*tmp_path.iterdir()]
