"""Sealed protocols: read without trust, tested with their own vehicles, and what is missing is named."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvbench.cli import main
from auvbench.config.compose import compose
from auvbench.errors import AuvbenchError, ConfigError
from auvbench.evaluation import sealed
from auvbench.evaluation.evaluate import evaluate, is_done
from auvbench.evaluation.protocol import left_out, resolve_conditions
from auvbench.runs.plan import prepare
from auvbench.training.execute import execute
from auvbench.vehicles import sheet
from auvbench.vehicles.changes import Changes, changed
from auvbench.vehicles.vehicle_model import VehicleModel

EXAMPLE = Path(__file__).parents[3] / "examples" / "sealed"
BASE: dict[str, Any] = {
    "name": "sealed-test",
    "nonce": "a1",
    "scenario_seed": 5,
    "episodes": 2,
    "tasks": ["waypoint", "transit"],
    "conditions": [{"name": "still water"}],
}


def written(folder: Path, **entries: Any) -> Path:
    path = folder / "sealed.json"
    path.write_text(json.dumps(BASE | entries))
    return path


def conditions(folder: Path, *entries: dict[str, Any], vehicle: str = "bluerov2") -> dict[str, Any]:
    """The resolved configuration of each condition, by name."""
    named = [{"name": f"c{n}"} | entry for n, entry in enumerate(entries)]
    protocol = sealed.read(written(folder, conditions=named))
    config = prepare(compose("train", [f"output={folder}", "algo=pid", f"vehicle={vehicle}"])).config()
    return {found.name: found.config for found in resolve_conditions(protocol, config)}


def model(
    folder: Path, entry: dict[str, Any], vehicle: str = "bluerov2"
) -> tuple[VehicleModel, VehicleModel]:
    """The vehicle of a condition, and the run's own."""
    return sheet.load(conditions(folder, entry, vehicle=vehicle)["c0"].vehicle), sheet.load(vehicle)


@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2_heavy", "bluerov2_heavy_wu2018", "rexrov"])
def test_factors_change_the_numbers_of_the_sheet(tmp_path: Path, vehicle: str) -> None:
    scale = {
        "mass": 0.9,
        "inertia": 1.2,
        "added_mass": 1.3,
        "linear_damping": 0.8,
        "quadratic_damping": 1.4,
        "thrust": 0.7,
    }
    new, old = model(tmp_path, {"scale": scale}, vehicle)
    assert new.mass == pytest.approx(0.9 * old.mass)
    assert new.buoyancy - new.weight == pytest.approx(old.buoyancy - old.weight)
    np.testing.assert_allclose(new.inertia, 1.2 * old.inertia)
    np.testing.assert_allclose(new.M_A, 1.3 * old.M_A)
    np.testing.assert_allclose(new.linear_damping, 0.8 * old.linear_damping)
    np.testing.assert_allclose(new.quadratic_damping, 1.4 * old.quadratic_damping)
    for (_, one), (_, other) in zip(new.thrusters, old.thrusters, strict=True):
        np.testing.assert_allclose(
            one.force([-1.0, -0.3, 0.5, 1.0]), 0.7 * other.force([-1.0, -0.3, 0.5, 1.0])
        )


@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2_heavy"])
def test_a_payload_is_a_point_mass_without_volume(tmp_path: Path, vehicle: str) -> None:
    at = np.array([0.1, -0.2, 0.3])
    new, old = model(tmp_path, {"payload_kg": 2.0, "payload_at_m": at.tolist()}, vehicle)
    assert new.mass == pytest.approx(old.mass + 2.0)
    assert new.buoyancy == pytest.approx(old.buoyancy)
    assert new.weight == pytest.approx(old.weight + 2.0 * old.gravity)
    center = (old.mass * old.center_of_gravity + 2.0 * at) / new.mass
    np.testing.assert_allclose(new.center_of_gravity, center, atol=1e-12)

    # About the body's origin inertias add up (Steiner).
    def about_origin(inertia: Any, mass: float, r: Any) -> Any:
        return inertia + mass * (r @ r * np.eye(3) - np.outer(r, r))

    whole = about_origin(new.inertia, new.mass, new.center_of_gravity)
    parts = about_origin(old.inertia, old.mass, old.center_of_gravity) + about_origin(
        np.zeros((3, 3)), 2.0, at
    )
    np.testing.assert_allclose(whole, parts, atol=1e-12)


@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2_heavy_wu2018"])
def test_thrusters_keep_their_shares_and_get_a_lag(tmp_path: Path, vehicle: str) -> None:
    entry = {"weak_thrusters": [6, 2], "weak_share": [0.5, 0.25], "thrust_scale": 0.8, "thruster_lag_s": 0.07}
    new, old = model(tmp_path, entry, vehicle)
    for number, ((_, one), (_, other)) in enumerate(zip(new.thrusters, old.thrusters, strict=True), start=1):
        share = 0.8 * {6: 0.5, 2: 0.25}.get(number, 1.0)
        np.testing.assert_allclose(one.force([-1.0, 0.7]), share * other.force([-1.0, 0.7]))
        assert one.lag.A.tolist() == [[pytest.approx(-1 / 0.07)]]
    assert new.actuators == old.actuators


def test_net_buoyancy_takes_the_place_of_the_sheets(tmp_path: Path) -> None:
    new, _ = model(tmp_path, {"net_buoyancy_n": -0.9, "scale": {"mass": 1.5}})
    assert new.buoyancy - new.weight == pytest.approx(-0.9)


def test_water_depth_and_readings(tmp_path: Path) -> None:
    entry = {"sea_state": 3, "current_m_per_s": 0.1, "depth_m": 5.5, "delay_s": 0.1}
    found = conditions(tmp_path, entry)["c0"]
    assert (found.disturbance.waves.height, found.disturbance.current.speed) == (0.88, 0.1)
    assert found.disturbance.delay.observation == 0.1
    assert found.task.start == [0, 0, -5.5]


def test_without_changes_a_sheet_stays(tmp_path: Path) -> None:
    values = prepare(compose("train", [f"output={tmp_path}", "algo=pid"])).config()["vehicle"]
    assert changed(values, Changes()) == values


def test_a_thruster_that_a_vehicle_lacks_leaves_the_condition_out(tmp_path: Path) -> None:
    entries = [{"name": "all"}, {"name": "eighth", "weak_thrusters": [8], "weak_share": [0.5]}]
    protocol = sealed.read(written(tmp_path, conditions=entries))
    config = prepare(compose("train", [f"output={tmp_path}", "algo=pid"])).config()
    (reason,) = left_out(protocol, resolve_conditions(protocol, config), config)
    assert reason == "condition eighth: vehicle bluerov2_2026: has no thruster 8; it has 6 thrusters"
    heavy = prepare(compose("train", [f"output={tmp_path}", "algo=pid", "vehicle=bluerov2_heavy"])).config()
    assert left_out(protocol, resolve_conditions(protocol, heavy), heavy) == []


def test_a_depth_that_a_task_cannot_have_leaves_the_condition_out(tmp_path: Path) -> None:
    protocol = sealed.read(
        written(
            tmp_path,
            tasks=["trajectory_tracking"],
            conditions=[{"name": "all"}, {"name": "shallow", "depth_m": 2.0}],
        )
    )
    run = prepare(compose("train", [f"output={tmp_path}", "algo=pid", "task=trajectory_tracking"]))
    (reason,) = left_out(protocol, resolve_conditions(protocol, run.config()), run.config())
    assert reason.startswith("condition shallow: task.centre=[0.0, 0.0, -2.0]: must have a z")


def test_what_cannot_be_simulated_is_named(tmp_path: Path) -> None:
    entries = [
        {"name": "still"},
        {"name": "lost", "dvl_lost_share": 0.3, "dvl_burst_s": 5.0},
        {"name": "bias", "heading_bias_deg": 8.0},
    ]
    protocol = sealed.read(written(tmp_path, conditions=entries))
    assert [condition.name for condition in protocol.conditions] == ["still"]
    assert [text.split(":")[0] for text in protocol.not_tested] == [
        "condition lost",
        "condition bias",
    ]


def test_a_run_of_another_task_is_refused(tmp_path: Path) -> None:
    protocol = sealed.read(written(tmp_path))
    run = prepare(compose("train", [f"output={tmp_path}", "algo=pid", "task=docking"]))
    with pytest.raises(
        ConfigError, match="tests only the tasks waypoint, transit, but the run has task docking"
    ):
        resolve_conditions(protocol, run.config())


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        ({"name": "test"}, "name test belongs to another protocol"),
        ({"name": "../x"}, "name must be letters"),
        ({"seed": 5}, "seed: unknown key"),
        ({"episodes": 0}, "episodes is 0"),
        ({"scenario_seed": -1}, "scenario_seed is -1"),
        ({"conditions": [{"name": "a", "curent_m_per_s": 1}]}, "did you mean 'current_m_per_s'"),
        ({"conditions": [{"name": "a", "scale": {"drag": 2}}]}, "scale.drag: unknown key"),
        ({"conditions": [{"name": "a", "scale": {"mass": 0}}]}, "scale.mass is 0"),
        ({"conditions": [{"name": "a", "sea_state": 9}]}, "sea_state is 9"),
        ({"conditions": [{"name": "a", "weak_thrusters": [1], "weak_share": []}]}, "same length"),
        ({"conditions": [{"name": "a", "payload_kg": 1, "payload_at_m": [1]}]}, "must be three numbers"),
        ({"conditions": [{"name": "a", "vehicle": "../sheet.yaml"}]}, "is not a valid name of a file below"),
        ({"conditions": [{"name": "a", "vehicle": "/etc/passwd"}]}, "is not a valid name of a file below"),
        ({"conditions": [{"name": "a", "vehicle": "missing.yaml"}]}, "put the sheet next to the protocol"),
        ({"conditions": [{"name": "a", "vehicle": "sealed.json"}]}, "must be a YAML file"),
        ({"conditions": [{"name": "a/b"}]}, "must have only letters"),
        ({"conditions": [{"name": "a"}, {"name": "a"}]}, "unique"),
        ({"conditions": []}, "at least one condition"),
    ],
)
def test_a_wrong_file_is_one_line(tmp_path: Path, entries: dict[str, Any], said: str) -> None:
    with pytest.raises(AuvbenchError, match=said) as error:
        sealed.read(written(tmp_path, **entries))
    assert "\n" not in str(error.value)


def test_a_link_next_to_the_file_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "sheet.yaml").symlink_to(EXAMPLE / "sheet.yaml")
    with pytest.raises(ConfigError, match="symbolic link"):
        sealed.read(written(tmp_path, conditions=[{"name": "a", "vehicle": "sheet.yaml"}]))


def test_the_example_is_read() -> None:
    protocol = sealed.read(EXAMPLE / "example.json")
    assert protocol.not_tested == []
    data = (EXAMPLE / "sheet.yaml").read_bytes()
    assert protocol.sha256["sheet.yaml"] == hashlib.sha256(data).hexdigest()


@pytest.mark.slow
def test_a_sealed_test_is_marked_and_done_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    run = prepare(compose("train", ["algo=pid"]))
    execute(run)
    (tmp_path / "sheet.yaml").write_bytes((EXAMPLE / "sheet.yaml").read_bytes())
    entries = [
        {"name": "still"},
        {"name": "other", "vehicle": "sheet.yaml"},
        {"name": "lost", "dvl_lost_share": 0.2},
    ]
    path = written(tmp_path, conditions=entries, tasks=["waypoint", "salvage"])
    assert main(["evaluate", "outputs", "protocol=sealed.json"]) == 0
    assert f"{run.id}: not tested: condition lost" in capsys.readouterr().out
    assert is_done(run, sealed.read(path))
    assert (
        main(
            [
                "report",
                "outputs",
                "--protocol",
                "sealed-test",
                "--format",
                "md",
                "--no-figures",
                "--out",
                "out",
            ]
        )
        == 0
    )
    text = (tmp_path / "out/report.md").read_text().replace("\\", "")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert f"Sealed protocol (SHA-256: sealed.json {digest[:11]}" in text
    assert "Not tested: task salvage" in text
    written(tmp_path, conditions=entries[:1])
    assert not is_done(run, sealed.read(path))


def test_a_sealed_protocol_is_tested_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path)
    assert main(["evaluate", str(tmp_path), f"protocol={path}", "protocol.episodes=1"]) == 2
    assert "cannot be changed; leave protocol.episodes=1 out" in capsys.readouterr().err
    assert main(["evaluate", str(tmp_path), f"protocol={tmp_path}/none.json"]) == 2
    assert "no such file" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("task", ["waypoint", "trajectory_tracking", "docking"])
def test_the_example_runs_on_each_task(tmp_path: Path, task: str) -> None:
    run = prepare(compose("train", [f"output={tmp_path}", "algo=pid", f"task={task}"]))
    execute(run)
    protocol = sealed.read(EXAMPLE / "example.json")
    protocol.episodes = 1
    summary = evaluate(run, protocol)
    assert summary is not None
    missing = len(summary["sealed"]["not_tested"])  # curves do not fit 5 m below the surface
    assert missing == (task == "trajectory_tracking")
    assert len(summary["conditions"]) == len(protocol.conditions) - missing == 6 - missing
