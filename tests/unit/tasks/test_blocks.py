"""Blocks of installed packages: chosen, part of a run's identity, checked, observed by pilots, and refused in one line."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from omegaconf import OmegaConf

from auvbench import cli
from auvbench.config import complete
from auvbench.config.compose import compose, typed
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.errors import AgentError, ConfigError, UserError
from auvbench.evaluation import reference
from auvbench.evaluation.protocol import fingerprint, resolve_conditions
from auvbench.integrations.commands import pilot
from auvbench.pilot import live_observation as observation
from auvbench.registry import BLOCKS
from auvbench.runs.identity import relevant, run_id
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles import sheet
from tests import configs
from tests.packages import EXAMPLE, Site, site

__all__ = ["site"]

DOPPLER = (EXAMPLE / "auvbench_example" / "doppler.py").read_text(encoding="utf-8")
SEEN = "task.observation=[yaw_error,position_error,doppler,velocity]"
BLOCK = slice(4, 7)


def measuring(site: Site, *changes: tuple[str, str], version: str = "1.0", package: str = "dopplers") -> None:
    """Installs the block of the example; each change replaces a text of its file."""
    text = DOPPLER
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    points = {"auvbench.blocks": {"doppler": "doppler:SPEC"}}
    site.install(package, {"doppler.py": text}, points=points, version=version)


def batch(*overrides: str, n: int = 3, interpreted: bool = False, seed: int = 3) -> Batch:
    made = Batch(train_config(compose("train", ["algo=pid", *overrides])), n, seed=seed)
    if interpreted:  # far quicker than to compile what is wrong
        made.task.interpret()
    return made


def flown(one: Batch, steps: int = 5) -> np.ndarray[Any, Any]:
    seen = [one.reset().copy()]
    for step in range(steps):
        turn = 7 * step + 5 * np.arange(one.n)[:, None] + 3 * np.arange(len(one.vehicle.actuators))
        seen.append(one.step((turn % 17 - 8) / 8.0).observation.copy())
    return np.array(seen)


def frozen(*overrides: str) -> dict[str, Any]:
    plain = OmegaConf.to_container(compose("train", ["algo=pid", *overrides]), resolve=True)
    assert isinstance(plain, dict)
    return {str(key): value for key, value in plain.items()}


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """The one line with which a command ends with exit code 2."""
    assert cli.main(list(words)) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1, error
    return error


@pytest.mark.slow
def test_it_measures_with_noise_of_its_own_and_leaves_the_others_be(site: Site) -> None:
    measuring(site)
    seen = flown(batch(SEEN), 60)
    noise = (seen[..., BLOCK] - seen[..., 7:]).astype(np.float64)
    assert abs(noise.std() / 0.02 - 1.0) < 0.15
    assert len(np.unique(noise)) == noise.size
    np.testing.assert_array_equal(seen, flown(batch(SEEN), 60))
    assert (flown(batch(SEEN, seed=4))[0, :, BLOCK] != seen[0, :, BLOCK]).all()
    # A row sees the same in any batch, and the other blocks are what they are without the package's.
    np.testing.assert_array_equal(flown(batch(SEEN, n=1), 60)[:, 0], seen[:, 0])
    without = flown(batch("task.observation=[yaw_error,position_error,velocity]"), 60)
    np.testing.assert_array_equal(np.delete(seen, BLOCK, axis=2), without)


@pytest.mark.slow
def test_compiled_and_interpreted_it_writes_the_same(site: Site) -> None:
    measuring(site)
    np.testing.assert_allclose(flown(batch(SEEN)), flown(batch(SEEN, interpreted=True)), rtol=1e-6, atol=1e-7)


@pytest.mark.slow
def test_a_copy_goes_on_by_itself_and_is_checked(site: Site) -> None:
    measuring(site)
    one = batch(SEEN)
    one.reset()
    for other in (copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        action = np.zeros((3, 6))
        ahead = other.step(action).observation.copy()
        assert one.task.episodes.steps.tolist() == [0, 0, 0]
        other.simulator.velocity[1] = 60.0
        with pytest.raises(AgentError, match=r"task\.observation=doppler of dopplers==1\.0"):
            other.task.observe(other.simulator.pose, other.simulator.velocity)
    np.testing.assert_array_equal(one.step(action).observation, ahead)


def test_its_package_is_part_of_a_run_s_identity(site: Site) -> None:
    measuring(site)
    first = frozen(SEEN)
    assert first["task"]["block_packages"] == {"doppler": "dopplers==1.0"}
    assert complete.releases(first) == {"dopplers": "1.0"}
    assert typed(OmegaConf.create(first)).task.block_packages == {"doppler": "dopplers==1.0"}
    measuring(site, version="2.0")
    assert run_id(first) != run_id(frozen(SEEN))
    with pytest.raises(
        ConfigError, match=r"task.observation=doppler: comes with dopplers==1\.0, and dopplers==2\.0 is"
    ):
        typed(OmegaConf.create(first))
    site.uninstall("dopplers")
    with pytest.raises(ConfigError, match=r"comes with dopplers==1\.0, and is not installed; pip install"):
        typed(OmegaConf.create(first))


def test_without_a_package_s_block_a_configuration_has_no_key_of_packages(site: Site) -> None:
    before = frozen()
    assert "block_packages" not in before["task"]
    measuring(site)
    assert frozen() == before
    assert relevant(before) == relevant(before | {"task": before["task"] | {"block_packages": {}}})


@pytest.mark.slow
def test_a_test_observes_it_and_meets_the_same_scenarios(site: Site) -> None:
    protocol = configs.protocol("protocol=test")
    without = resolve_conditions(protocol, frozen())
    measuring(site)
    conditions = resolve_conditions(protocol, frozen(SEEN))
    assert {tuple(c.config.task.observation) for c in conditions} == {
        ("yaw_error", "position_error", "doppler", "velocity")
    }
    assert {str(c.config.task.block_packages) for c in conditions} == {"{'doppler': 'dopplers==1.0'}"}
    assert fingerprint(protocol, conditions) == fingerprint(protocol, without)
    config = conditions[0].config
    assert reference.digest(config, None) == reference.digest(without[0].config, None)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("task.observation=[doppler,dopler]",), "dopler is not a block of task=waypoint; did you mean 'doppler'?"),
        (("task.observation=[doppler,doppler]",), "doppler occurs twice"),
        ((SEEN, "+task.block_packages={doppler: x}"), "task.block_packages={'doppler': 'x'}: auvbench sets it"),
        (("task.block_packages={velocity: x}",), "task.block_packages.velocity: unknown key"),
    ],
)  # fmt: skip
def test_what_is_typed_wrong_is_one_line(
    site: Site, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], message: str
) -> None:
    measuring(site)
    assert message in refused(capsys, "train", "algo=pid", *words)


@pytest.mark.parametrize(
    ("reads", "task", "message"),
    [
        ("goal", "waypoint", "doppler of dopplers==1.0 reads the goal, which task=waypoint does not have here"),
        ("preview", "path_following", "reads the preview, which task=path_following does not have here; task.preview.points sets it"),
        ("task", "docking", "reads fields that only other tasks have, not task=docking"),
        ("team", "docking", "reads the team, which task=docking does not have here"),
    ],
)  # fmt: skip
def test_what_it_reads_a_task_must_have(
    site: Site, capsys: pytest.CaptureFixture[str], reads: str, task: str, message: str
) -> None:
    measuring(site, ('reads=("velocity",)', f'reads=("velocity", "{reads}")'))
    more = ["task.preview.points=0"] if reads == "preview" else []
    assert message in refused(
        capsys, "train", "algo=pid", f"task={task}", "vehicle=bluerov2_heavy", SEEN, *more
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('SPEC = BlockSpec("doppler", write, describe', 'SPEC = dict(a=1'), "is a dict; it must be an auvbench.plugin.BlockSpec"),
        (('BlockSpec("doppler"', 'BlockSpec("log"'), "has the name 'log'; it must have the name of its entry point"),
        (('reads=("velocity",)', 'reads=("speed",)'), "reads 'speed'; did you mean 'preview'? valid: action, goal, navigation, pose, preview, solids, task, team, velocity"),
        (("def write(m, e, p, out)", "def write(m, e, out)"), "has a write that is not a function of 4 arguments"),
        (('"doppler", write,', '"doppler", lambda m, e, p, out: None,'), "has a write that is not a function of its module"),
        (('"doppler", write,', '"doppler", math.sqrt,'), "cannot be imported: NameError"),
        (("def describe(setting)", "def describe()"), "has a describe that is not a function of 1 argument"),
    ],
)  # fmt: skip
def test_what_it_declares_wrong_is_one_line(
    site: Site, capsys: pytest.CaptureFixture[str], change: tuple[str, str], message: str
) -> None:
    measuring(site, change)
    error = refused(capsys, "train", "algo=pid", SEEN)
    assert message in error
    assert "of dopplers==1.0" in error


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("u + SIGMA * nu", "float('nan')"), "write gives doppler_x=nan; it must be within [-50, 50], in environment 0 at step 0"),
        (("w + SIGMA * nw", "80.0"), "write gives doppler_z=80; it must be within [-50, 50]"),
        (("out[0], out[1], out[2] =", "out[0], _, out[2] ="), "write gives doppler_y=nan; it must be within [-50, 50]"),
        (("out[0], out[1], out[2] =", "out[0], out[1], out[3] ="), "write fails: IndexError"),
        (("m.velocity", "m.speed"), "write fails: AttributeError"),
        (('"doppler", "m/s"', '"log", "m/s"'), "describe must return an auvbench.plugin.Block with the name of this block"),
        (("(FASTEST,) * 3", "(FASTEST,) * 2"), "its bounds must be 3 positive numbers, one for each label"),
        (("(FASTEST,) * 3", "(FASTEST, FASTEST, float('nan'))"), "its bounds must be 3 positive numbers"),
        (("    return vector", "    return setting.nothing or vector"), "describe fails: AttributeError"),
    ],
)  # fmt: skip
def test_what_it_writes_wrong_names_its_package(site: Site, change: tuple[str, str], message: str) -> None:
    measuring(site, change)
    with pytest.raises(AgentError) as raised:
        flown(batch(SEEN, interpreted=True), 1)
    assert "task.observation=doppler of dopplers==1.0: " in str(raised.value)
    assert message in str(raised.value)


@pytest.mark.slow
def test_what_cannot_be_compiled_is_one_line_with_its_place(site: Site) -> None:
    measuring(site, ("u + SIGMA * nu", "u + 'one'"))
    with pytest.raises(AgentError) as raised:
        flown(batch(SEEN), 1)
    assert "task.observation=doppler of dopplers==1.0: write fails: it cannot be compiled" in str(
        raised.value
    )
    assert "\n" not in str(raised.value)


@pytest.mark.slow
def test_a_block_reads_the_fields_of_the_task_that_names_it(site: Site) -> None:
    """A package's task with a block of its own: the distance to the pole that it circles."""
    circling = (EXAMPLE / "auvbench_example" / "circling.py").read_text(encoding="utf-8")
    text = """
        from auvbench.blocks import Block, BlockSpec

        def write(m, e, p, out):
            out[0] = e.angle + 10.0 * p.radius

        def describe(setting):
            return Block("place", ("place",), "rad", (100.0,), "place on the circle")

        SPEC = BlockSpec("place", write, describe, reads=("task",))
    """
    root = EXAMPLE / "auvbench_example"
    files = {f"auvbench_example/{n}": (root / n).read_text(encoding="utf-8") for n in ("view.py", "conf/task/circling.yaml", "conf/reward/view.yaml")}  # fmt: skip
    files |= {"auvbench_example/place.py": text, "auvbench_example/__init__.py": ""}
    files["auvbench_example/circling.py"] = circling.replace("blocks=ERRORS", 'blocks=(*ERRORS, "place")')
    site.install(
        "auvbench-example",
        files,
        tasks={"circling": "auvbench_example.circling:SPEC"},
        rewards={"view": "auvbench_example.view:SPEC"},
        points={"auvbench.blocks": {"place": "auvbench_example.place:SPEC"}},
        conf="auvbench_example.conf",
    )
    words = ("task=circling", "vehicle=bluerov2_heavy", "task.observation=[place,velocity]")
    for interpreted in (True, False):
        one = batch(*words, interpreted=interpreted)
        seen = flown(one, 1)[0]
        np.testing.assert_allclose(seen[:, 0], one.task.episodes.angle + 30.0, rtol=1e-6)
    reference.digest(one.config, None)


@pytest.mark.slow
def test_packages_with_blocks_of_one_name_do_not_take_each_other_s_code(site: Site, tmp_path: Path) -> None:
    seen = []
    for package, change in (("dopplers", ()), ("others", (("u + SIGMA", "3.0 * u + SIGMA"),))):
        measuring(site, *change, package=package)
        seen.append([flown(batch(SEEN))[-1, :, BLOCK] for _ in range(2)])
        code = "from tests.unit.tasks.test_blocks import BLOCK, SEEN, batch, flown; print(flown(batch(SEEN))[-1, :, BLOCK].tolist())"
        paths = os.pathsep.join((str(site.folder), str(Path(__file__).parents[3])))
        for _ in range(2):  # the second process takes the code of the first
            done = subprocess.run(
                [sys.executable, "-c", code],
                capture_output=True,
                text=True,
                check=True,
                env={**os.environ, "PYTHONPATH": paths},
            )
            assert done.stdout.strip() == str(seen[-1][0].tolist())
        assert "compiling" not in done.stderr
        site.uninstall(package)
    (first, again), (other, once_more) = seen
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(other, once_more)
    np.testing.assert_array_equal(first[:, 1:], other[:, 1:])
    assert (first[:, 0] != other[:, 0]).all()


def test_a_pilot_observes_it_without_noise(site: Site) -> None:
    measuring(site)
    assert "doppler" not in observation.supplied()
    config = train_config(compose("train", ["algo=pid", SEEN]))
    assert "doppler" in observation.supplied()
    spec = observation_spec(config.task, tuple("abcdef"))
    pose = np.array([1.0, 2.0, -5.0, 1.0, 0.0, 0.0, 0.0])
    velocity = np.array([0.5, -0.25, 0.125, 0.0, 0.0, 0.0])
    seen = observation.observe(spec, pose, velocity, np.zeros(3), np.zeros(6), yaw=None, depth=(-60.0, -1.0))
    np.testing.assert_array_equal(seen[BLOCK], [0.5, -0.25, 0.125])
    assert BLOCKS["doppler"].code == "doppler:write"


def test_a_pilot_takes_a_policy_s_blocks_from_its_card(site: Site) -> None:
    measuring(site)
    vehicle = sheet.load("bluerov2")
    config = train_config(compose("train", ["algo=pid", SEEN]))
    observed = [entry["name"] for entry in observation_spec(config.task, vehicle.actuators).card()]
    site.look_again()

    def flown_by(packages: Any) -> Any:
        limits = {"depth_low_m": -60.0, "depth_high_m": -1.0, "max_steps": 1000, "goal_radius_m": 1.0}
        document = {"task": {"name": "waypoint", **limits, "block_packages": packages}}
        frame = SimpleNamespace(position_frame="world")
        card: Any = SimpleNamespace(document=document, observed=observed, task=frame)
        return pilot.task_of_policy("policy.onnx", card, None, vehicle)

    task, spec = flown_by({"doppler": "dopplers==1.0"})
    assert list(spec.blocks) == ["yaw_error", "position_error", "doppler", "velocity"]
    assert task.block_packages == {"doppler": "dopplers==1.0"}
    with pytest.raises(ConfigError, match=r"comes with dopplers==2\.0, and dopplers==1\.0 is installed"):
        flown_by({"doppler": "dopplers==2.0"})
    with pytest.raises(UserError, match="its card has an invalid task entry: block_packages="):
        flown_by({"doppler": 2.0})
    site.look_again()
    with pytest.raises(UserError, match="observes doppler_x, which a pilot cannot supply"):
        flown_by({})


def test_a_pilot_compiles_nothing_for_it(site: Site) -> None:
    measuring(site)
    code = (
        "import sys; from auvbench.registry import BLOCKS; from auvbench.pilot.live_observation import supplied; "
        "BLOCKS.choose('doppler', 'dopplers==1.0'); print('doppler' in supplied(), 'numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "True False\n"


def test_two_packages_of_one_block_are_refused(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    measuring(site)
    measuring(site, package="others")
    assert "dopplers and others each provide a part of this name" in refused(
        capsys, "train", "algo=pid", SEEN
    )
