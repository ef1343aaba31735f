"""`auvbench export` and `algo=onnx`: out of a run, into a run, and what is in the way of either."""

from __future__ import annotations

import copy
import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("onnx")
import torch
from omegaconf import OmegaConf

from auvbench import cli
from auvbench.agents.learned import learners, trained_policy
from auvbench.commands import export
from auvbench.config.compose import compose
from auvbench.errors import RunError
from auvbench.evaluation import exporting
from auvbench.evaluation.evaluate import make_agent, read_summary
from auvbench.policies import exported
from auvbench.runs.directory import RunDirectory
from auvbench.runs.plan import plan, prepare
from auvbench.vehicles import sheet
from tests import configs, onnx_files
from tests.conftest import Once
from tests.onnx_files import model, saved
from tests.unit.runs.test_damage import frozen

BRIEF = ["protocol.episodes=3", "--workers", "1"]


def trained(folder: Path, *overrides: str) -> RunDirectory:
    """A complete run with the weights that training begins from, and statistics of observations."""
    run = frozen(folder, *overrides, state="pending")
    config = configs.training(*overrides)
    torch.manual_seed(0)
    vehicle = sheet.load(config.vehicle)
    policy = trained_policy._policy(config, vehicle)
    with torch.no_grad():
        for parameter in policy.parameters():
            parameter.copy_(torch.randn_like(parameter) * 0.1)
    rng = np.random.default_rng(0)
    n = trained_policy.observed(config, vehicle)
    arrays = {
        "observation_mean": rng.normal(size=n),
        "observation_variance": rng.uniform(0.1, 30.0, size=n),
        "epsilon": np.asarray(1e-8),
        "clip_observations": np.asarray(10.0),
    }
    import io

    weights, statistics = io.BytesIO(), io.BytesIO()
    torch.save(dict(policy.state_dict()), weights)
    np.savez(statistics, **arrays)  # type: ignore[arg-type]
    files = run.write_model(
        {learners.WEIGHTS: weights.getvalue(), learners.STATISTICS: statistics.getvalue()}
    )
    run.update_manifest(state="complete", files=files, steps=1)
    return run


LEARNERS = [
    ("algo=ppo",),
    ("algo=ppo", "algo.activation=elu", "algo.net_arch=[32]"),
    ("algo=ppo", "train.normalise_observations=false"),
    ("algo=sac", "algo.updates=sb3", "algo.activation=silu"),
    ("algo=td3",),
    ("algo=crossq",),
    ("algo=tqc",),
    ("algo=trpo",),
    ("algo=ddpg", "task.position_frame=body", "step.frequency=25"),
]


@pytest.mark.slow
@pytest.mark.parametrize("overrides", LEARNERS, ids=" ".join)
def test_an_exported_policy_acts_as_its_run_does(tmp_path: Path, overrides: tuple[str, ...]) -> None:
    run = trained(tmp_path / "runs", *overrides)
    done = exporting.export(run, tmp_path / "out")
    assert done.path == tmp_path / "out" / f"{run.id}.onnx"
    assert done.observations > 6000
    algo = run.config()["algo"]
    assert not exporting.why_no_network(algo["name"], algo["agent"], True)
    assert 0.0 < done.difference <= exporting.LIMIT
    # Independently of the check that `export` makes itself.
    policy = exported.load(done.path)
    frequency = float(run.config()["step"]["frequency"])
    seen = (np.random.default_rng(3).normal(size=(500, 10)) * 8.0).astype(np.float32)
    own = make_agent(run, frequency).act(seen)
    np.testing.assert_allclose(policy.act(seen), own, atol=1e-5, rtol=0.0)
    assert np.ptp(own, axis=0).min() > 1e-3  # it does answer differently to different observations


@pytest.mark.slow
def test_the_same_run_gives_the_same_bytes(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    run = trained(tmp_path / "runs", "algo=sac")
    capfd.readouterr()
    one, other = (exporting.export(run, tmp_path / name) for name in ("a", "b"))
    assert capfd.readouterr() == ("", "")  # none of the exporter's notes
    assert one.path.read_bytes() == other.path.read_bytes()
    assert b".py" not in one.path.read_bytes()  # nor do they name files of this machine
    assert one.card_path.read_bytes() == other.card_path.read_bytes()


@pytest.mark.slow
def test_the_card_says_what_goes_in_and_out(tmp_path: Path) -> None:
    run = trained(tmp_path / "runs", "algo=ppo", "seed=3")
    assert cli.main(["evaluate", str(run.path), *BRIEF]) == 0
    done = exporting.export(run)
    assert done.path.parent == run.path / "exports"
    card = json.loads(done.card_path.read_text())
    assert card["file"]["sha256"] == exported.load(done.path).sha256
    assert [entry["name"] for entry in card["observation"]][:2] == ["yaw_error", "position_error_x"]
    assert [entry["unit"] for entry in card["observation"]] == ["rad", *"mmm", *["1"] * 6]
    assert [entry["name"] for entry in card["action"]] == [f"thruster{i}" for i in range(1, 7)]
    assert card["action"][0]["command_high"] == 40.0
    assert card["action"][0]["command_unit"] == "N"
    assert card["run"]["config_sha256"].startswith(run.id.rpartition("-")[2])
    summary = read_summary(run, "test")
    assert summary is not None
    (test,) = card["tests"]
    assert test["fingerprint"] == summary["fingerprint"]
    assert test["conditions"][0]["success_rate"] == summary["conditions"][0]["success_rate"]
    assert card["check"] == {
        "observations": done.observations,
        "largest_difference": done.difference,
        "limit": 1e-5,
    }


@pytest.mark.slow
def test_a_file_that_acts_otherwise_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = trained(tmp_path / "runs", "algo=ppo")
    policy = trained_policy.FrozenPolicy

    def other(self: Any) -> Any:
        network, scaling = self.policy, (self._mean, 1.0001 * self._scale, self._clip)
        return network, scaling

    monkeypatch.setattr(policy, "network", other)
    with pytest.raises(RunError, match=r"differ from the run's by .*, more than 1e-05; nothing was written"):
        exporting.export(run)
    assert not (run.path / "exports").exists()


def _reordered(policy: Any) -> Any:
    """Return the same function with the first layer's units in another order."""
    policy = copy.deepcopy(policy)
    first, second = policy.actor.mu[0], policy.actor.mu[2]
    order = torch.arange(first.out_features).flip(0)
    with torch.no_grad():
        first.weight.copy_(first.weight[order].clone())
        first.bias.copy_(first.bias[order].clone())
        second.weight.copy_(second.weight[:, order].clone())
    return policy


@pytest.mark.slow
def test_large_weights_magnify_rounding_in_the_run_as_in_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As DDPG's grow in 200,000 steps: the file is 5e-5 from the run, whose own last bits are worth as much.

    The file has its hidden units in another order, so that the two round differently on every processor.
    """
    run = trained(tmp_path / "runs", "algo=ddpg")
    ordinary = exporting.make_agent

    def magnified(*words: Any) -> Any:
        agent = ordinary(*words)
        with torch.no_grad():
            for name, weights in agent.network()[0].named_parameters():
                if name.startswith("actor.") and name.endswith("weight"):
                    weights.mul_(8.0)
        network, scaling = agent.network()
        monkeypatch.setattr(agent, "network", lambda: (_reordered(network), scaling))
        return agent

    monkeypatch.setattr(exporting, "make_agent", magnified)
    done = exporting.export(run)
    assert done.difference > exporting.LIMIT
    check = exported.load(done.path).card.document["check"]
    assert done.difference <= check["limit"] < 1e-2


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["recurrent_ppo", "ppo_residual", "sac_residual"])
def test_what_is_more_than_a_network_is_not_exported(
    tmp_path: Path, algo: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run = trained(tmp_path, f"algo={algo}")
    assert cli.main(["export", str(run.path)]) == 2
    assert f"{algo} cannot be exported: its policy is not a network" in capsys.readouterr().err
    assert exporting.why_no_network(algo, run.config()["algo"]["agent"], True)


@pytest.mark.parametrize(
    ("algo", "message"),
    [("pid", "a controller, not a trained network"), ("random", "a controller, not a trained network")],
)
def test_what_has_no_network_is_not_exported(
    tmp_path: Path, algo: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run = frozen(tmp_path, f"algo={algo}")
    assert cli.main(["export", str(run.path)]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.slow
def test_export_of_a_folder_leaves_out_what_has_no_network(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trained(tmp_path, "algo=ppo")
    frozen(tmp_path, "algo=pid")
    unfinished = frozen(tmp_path, "algo=td3", state="interrupted")
    assert cli.main(["export", str(tmp_path), "--out", str(tmp_path / "out")]) == 1
    out, err = capsys.readouterr()
    assert "skipped, no trained network: pid-" in out
    assert f"{unfinished.path}: the run is interrupted, not complete" in err
    assert len(list((tmp_path / "out").iterdir())) == 2


@pytest.mark.slow
def test_a_missing_extra_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import importlib.util

    run = trained(tmp_path, "algo=ppo")
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "onnx" else found(name, *a)
    )
    assert cli.main(["export", str(run.path)]) == 2
    assert "pip install 'auvbench[onnx]'" in capsys.readouterr().err


# Into a run.


def entered(path: Path, folder: Path, *overrides: str) -> list[str]:
    return [
        *configs.original(
            "algo=onnx", f"algo.path={path}", f"output={folder}", "task.max_steps=60", *overrides
        )
    ]


def torch_file(path: Path) -> Path:
    """A policy of plain PyTorch, written by PyTorch's own exporter."""
    torch.manual_seed(1)
    net = torch.nn.Sequential(
        torch.nn.Linear(10, 16), torch.nn.ReLU(), torch.nn.Linear(16, 6), torch.nn.Tanh()
    )
    with torch.no_grad():
        torch.onnx.export(
            net, (torch.zeros(1, 10),), path, dynamo=False, input_names=["obs"], output_names=["act"],
            dynamic_axes={"obs": {0: "batch"}, "act": {0: "batch"}},
        )  # fmt: skip
    return path


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of that exporter, which needs no further package
@pytest.mark.slow
def test_a_file_from_plain_torch_is_trained_evaluated_and_ranked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = torch_file(tmp_path / "plain torch.onnx")
    other = saved(tmp_path / "by_hand.onnx", model(gain=0.5))
    for file in (path, other):
        assert cli.main(["train", *entered(file, tmp_path / "out")]) == 0
    assert cli.main(["evaluate", str(tmp_path / "out"), *BRIEF]) == 0
    capsys.readouterr()
    assert cli.main(["report", str(tmp_path / "out")]) == 0
    table = capsys.readouterr().out
    assert "plain-torch" in table
    assert "by_hand" in table
    run = plan(compose("train", entered(path, tmp_path / "out"))).run
    path.unlink()  # the run has a copy of its own
    assert cli.main(["evaluate", str(run.path), *BRIEF, "--force"]) == 0


@pytest.mark.slow
def test_where_a_file_lies_does_not_matter_and_what_it_holds_does(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        (tmp_path / name).mkdir()
    here = saved(tmp_path / "a" / "p.onnx", model())
    there = saved(tmp_path / "b" / "p.onnx", model())
    changed = saved(tmp_path / "c" / "p.onnx", model(seed=1))
    ids = [plan(compose("train", entered(p, tmp_path))).run.id for p in (here, there, changed)]
    assert ids[0] == ids[1] != ids[2]
    named = plan(compose("train", entered(here, tmp_path, "algo.name=mine"))).run.id
    assert named.startswith("mine-")


@pytest.mark.slow
@pytest.mark.parametrize("path", ["", ".", "/", "..", "a" * 300, "nowhere/p.onnx"])
def test_a_path_that_is_no_file_is_one_line(
    tmp_path: Path, path: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["train", "algo=onnx", f"algo.path={path}", f"output={tmp_path}"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("auvbench: ")
    assert err.count("\n") == 1


@pytest.mark.slow
def test_a_digest_that_is_typed_must_be_the_file_s(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = saved(tmp_path / "p.onnx", model())
    assert cli.main(["train", *entered(path, tmp_path, "algo.sha256=0123")]) == 2
    assert "algo.sha256=0123: algo.path=" in capsys.readouterr().err
    digest = exported.load(path).sha256
    assert cli.main(["train", *entered(path, tmp_path, f"algo.sha256={digest}")]) == 0


@pytest.mark.slow
def test_an_exported_policy_has_the_outcomes_of_its_run(tmp_path: Path) -> None:
    run = trained(tmp_path / "runs", "algo=ppo", "task.max_steps=60")
    done = exporting.export(run, tmp_path / "files")
    mine = prepare(compose("train", entered(done.path, tmp_path / "runs")))
    assert mine.id.startswith(run.id)
    assert cli.main(["train", *entered(done.path, tmp_path / "runs")]) == 0
    assert cli.main(["evaluate", str(tmp_path / "runs"), "protocol.episodes=20", "--workers", "1"]) == 0
    rows = []
    for one in (run, mine):
        lines = (one.evaluation("test") / "episodes.csv").read_text().splitlines()
        outcome, steps = (lines[0].split(",").index(name) for name in ("outcome", "steps"))
        rows.append([(line.split(",")[outcome], line.split(",")[steps]) for line in lines[1:]])
    assert rows[0] == rows[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "vehicle=bluerov2_heavy",
            r"its card is for the vehicle bluerov2, which has the actuators thruster1",
        ),
        ("step.frequency=25", r"acts at 10 Hz; type step.frequency=10"),
        ("task.position_frame=body", r"type task.position_frame=world"),
    ],
)
def test_a_card_of_another_vehicle_clock_or_frame_is_told(
    once: Once, tmp_path: Path, override: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def make(folder: Path) -> None:
        exporting.export(trained(folder / "runs", "algo=ppo"), folder)

    (path,) = once("exported-ppo", make).glob("*.onnx")
    assert cli.main(["train", *entered(path, tmp_path / "out", override)]) == 2
    err = capsys.readouterr().err
    assert message.replace("\\", "") in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "words",
    [
        ["task=waypoint"],
        ["task=waypoint_state"],
        ["task=docking"],
        ["task=waypoint", "task.history=3"],
        ["task=waypoint", "task.position_frame=body", "task.observation=[yaw_error,position_error]"],
        ["task=trajectory_tracking", "task.preview.points=2"],
    ],
)
def test_the_words_of_a_task_give_its_observation(words: list[str]) -> None:
    task = OmegaConf.to_container(compose("train", words).task)
    assert isinstance(task, dict)
    assert export._task(task) == words


@pytest.mark.slow
def test_the_next_command_observes_what_the_policy_observes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = trained(tmp_path / "runs", "algo=ppo", "task=waypoint_state", "task.history=3")
    assert cli.main(["export", str(run.path), "--out", str(tmp_path / "files")]) == 0
    typed = shlex.split(capsys.readouterr().out.split("next: auvbench ")[1])
    assert cli.main([*typed, f"output={tmp_path / 'out'}"]) == 0


@pytest.mark.slow
def test_a_policy_of_another_task_is_told_and_its_next_command_works(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = trained(tmp_path / "runs", "algo=ppo", "task=docking", "vehicle=bluerov2_heavy")
    assert cli.main(["export", str(run.path), "--out", str(tmp_path / "files")]) == 0
    typed = capsys.readouterr().out.split("next: auvbench ")[1].split()
    assert typed[-2:] == ["vehicle=bluerov2_heavy", "task=docking"]
    assert cli.main([*typed, f"output={tmp_path / 'out'}"]) == 0
    assert cli.main([*typed[:-1], "task=station_keeping", f"output={tmp_path / 'other'}"]) == 2
    err = capsys.readouterr().err
    assert "observes goal_error_x, which is not observed here" in err
    assert "the task and the blocks of its training, task=docking" in err
    # The task first: its frame alone would not do.
    assert cli.main([*typed[:-1], f"output={tmp_path / 'other'}"]) == 2
    assert "of its training, task=docking" in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: onnx_files.ending("Log"), "an action must be a finite number in [-1, 1]"),
        (lambda: onnx_files.ending("Identity", gain=3.0), "an action must be a finite number in [-1, 1]"),
        (lambda: mixing(), "depends on the other rows of the batch"),
    ],
)
def test_a_file_that_answers_no_actions_is_a_failed_run(
    tmp_path: Path, make: Any, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = saved(tmp_path / "wild.onnx", make())
    assert cli.main(["train", *entered(path, tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
    run = plan(compose("train", entered(path, tmp_path / "out"))).run
    manifest = run.manifest()
    assert manifest["state"] == "failed"
    assert message in manifest["error"]["message"]


def mixing() -> Any:
    """An action less the mean over the batch."""
    from onnx import helper

    return model(
        [
            helper.make_node("MatMul", ["x", "W"], ["h"]),
            helper.make_node("ReduceMean", ["h"], ["m"], axes=[0], keepdims=1),
            helper.make_node("Sub", ["h", "m"], ["s"]),
            helper.make_node("Tanh", ["s"], ["a"]),
        ]
    )


@pytest.mark.slow
def test_a_grid_goes_on_without_the_one_that_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = saved(tmp_path / "good.onnx", model())
    bad = saved(tmp_path / "bad.onnx", onnx_files.ending("Log"))
    grid = [
        *configs.original(
            "algo=onnx", f"algo.path={good},{bad}", f"output={tmp_path / 'out'}", "launcher.workers=1"
        )
    ]
    assert cli.main(["train", "-m", *grid]) == 1
    states = {
        path.parent.name.partition("-")[0]: json.loads(path.read_text())["state"]
        for path in (tmp_path / "out").glob("*/*/manifest.json")
    }
    assert states == {"good": "complete", "bad": "failed"}


@pytest.mark.slow
def test_a_run_whose_file_was_lost_or_changed_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = saved(tmp_path / "p.onnx", model())
    line = entered(path, tmp_path / "out")
    assert cli.main(["train", *line]) == 0
    run = plan(compose("train", line)).run
    kept = run.model / "policy.onnx"
    kept.write_bytes(model(seed=7).SerializeToString())
    assert cli.main(["train", *line]) == 0  # the same command puts it back
    assert kept.read_bytes() == path.read_bytes()
    kept.unlink()
    capsys.readouterr()
    assert cli.main(["evaluate", str(run.path), *BRIEF]) == 2
    assert "auvbench" in capsys.readouterr().err
    assert cli.main(["resume", str(run.path)]) == 2
    assert "policy.onnx is missing" in capsys.readouterr().err
