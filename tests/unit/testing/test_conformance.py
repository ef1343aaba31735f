"""Our own agents keep the contracts, and who breaks one is told which."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from auvbench import testing
from auvbench.errors import ConfigError
from auvbench.testing import ConformanceError, agents
from tests.packages import DRAWN, Site, learning, site, steering

__all__ = ["site"]

CONTROLLERS = ("pid", "random", "lqr", "smc", "adrc")


@pytest.mark.parametrize("algo", CONTROLLERS)
@pytest.mark.parametrize("check", testing.AGENT_CHECKS, ids=lambda check: check.__name__)
def test_our_controllers(algo: str, check: object) -> None:
    testing.check_agent(f"algo={algo}", only=check)  # type: ignore[arg-type]


def test_pid_on_fins() -> None:
    testing.check_agent("algo=pid", "vehicle=lrauv")


@pytest.mark.parametrize(
    ("act", "message"),
    [
        ("return np.zeros((len(observation), 3))", "shape (7, 3); it must be (7, 6)"),
        ("return np.full((len(observation), self.n_u), np.nan)", "nan; actions must be in [-1, 1]"),
        ("return np.full((len(observation), self.n_u), -1.01)", "-1.01; actions must be in [-1, 1]"),
        (
            "return np.tile(np.tanh(observation[:, 1:2].mean() + 0.0 * observation[:, 1:2]), (1, self.n_u))",
            "do not depend on the batch: in a batch of 1 instead of 7",
        ),
        (
            "self.seen = getattr(self, 'seen', 0) + 1\nreturn np.full((len(observation), self.n_u), np.sin(self.seen))",
            "in a batch of 1 instead of 7",
        ),
        ("return np.random.uniform(-1.0, 1.0, (len(observation), self.n_u))", "in a batch of 1"),
        (
            "observation += 1.0\nreturn np.zeros((len(observation), self.n_u))",
            "act must not change its observations",
        ),
    ],
)
def test_a_controller_that_breaks_its_contract(site: Site, act: str, message: str) -> None:
    steering(site, act)
    with pytest.raises(ConformanceError) as caught:
        testing.check_agent("algo=mine")
    assert message in str(caught.value)
    assert str(caught.value).startswith("algo=mine: ")


def test_memory_across_episodes_is_found_by_its_own_check(site: Site) -> None:
    steering(
        site,
        "self.seen = getattr(self, 'seen', 0) + 1\nreturn np.full((len(observation), self.n_u), np.sin(self.seen))",
    )
    with pytest.raises(ConformanceError, match="nothing outlives an episode: in the same episodes once more"):
        testing.check_agent("algo=mine", only=agents.nothing_outlives_an_episode)


def test_draws_from_the_process_are_found_by_their_own_check(site: Site) -> None:
    steering(site, "np.random.uniform()\nreturn np.zeros((len(observation), self.n_u))")
    with pytest.raises(ConformanceError, match=r"must not draw from the global generator of numpy\.random"):
        testing.check_agent("algo=mine", only=agents.actions_are_deterministic)


@pytest.mark.slow
@pytest.mark.parametrize("exact", [True, False])
def test_a_learner_that_keeps_its_contract(site: Site, exact: bool) -> None:
    learning(site, exact=exact)
    testing.check_agent("algo=slow", steps=400)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("check", "old", "new", "message"),
    [
        (
            agents.training_is_deterministic,
            DRAWN,
            "action = np.random.uniform(-1, 1, (environment.n, self.n_u))",
            "training is deterministic: the same",
        ),
        (
            agents.actions_do_not_depend_on_the_batch,
            "return np.full((len(observation), self.n_u), np.tanh(self.sum))",
            "self.sum += 1e-3; return np.full((len(observation), self.n_u), np.tanh(self.sum))",
            "do not depend on the batch",
        ),
        (
            agents.nothing_is_pickled,
            "(folder / \"sum.json\").write_text(json.dumps(self.sum))",
            "import pickle; (folder / \"sum.json\").write_bytes(pickle.dumps(self.sum))",
            "sum.json is a pickle",
        ),
        (
            agents.nothing_is_pickled,
            "self.sum = json.loads((folder / \"sum.json\").read_text())",
            "import pickle, pathlib; pickle.loads(pickle.dumps(pathlib.PurePosixPath('/'))); "
            "self.sum = json.loads((folder / \"sum.json\").read_text())",
            "load unpickles pathlib",
        ),
        (
            agents.a_stopped_training_ends_as_it_says,
            "self.sum, self.generator.bit_generator.state = components.values[\"slow\"]",
            "self.sum = components.values[\"slow\"][0]",
            "a training that was stopped must write the same bits",
        ),
        (
            agents.a_stopped_training_ends_as_it_says,
            "callbacks.checkpoint(steps)",
            "pass",
            "learn did not call callbacks.checkpoint before step 300 of 400",
        ),
    ],
)  # fmt: skip
def test_a_learner_that_breaks_its_contract(
    site: Site, check: Callable[[object], None], old: str, new: str, message: str
) -> None:
    learning(site)
    path = site.folder / "slow/learning.py"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    site.look_again()
    with pytest.raises(ConformanceError) as caught:
        testing.check_agent("algo=slow", steps=400, only=check)
    assert message in str(caught.value)


def pytest_says(*words: str) -> subprocess.CompletedProcess[str]:
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "pytest_auvbench",
        "-p",
        "no:cacheprovider",
        "-q",
        *words,
    ]
    root = str(Path(__file__).parents[3])
    import os

    paths = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": paths}
    )


@pytest.mark.slow
def test_pytest_runs_the_checks_one_by_one(site: Site) -> None:
    steering(site, "return np.full((len(observation), self.n_u), 1.5)")
    words = ("--auvbench", "algo=mine", "--auvbench", "task=waypoint", "--auvbench", "command=verify")
    done = pytest_says(*words, "-rA")
    assert done.returncode == 1
    assert f"{len(testing.TASK_CHECKS) + len(testing.COMMAND_CHECKS)} passed" in done.stdout
    assert f"{len(testing.AGENT_CHECKS)} failed" in done.stdout
    assert "gets the action 1.5; actions must be in [-1, 1]" in done.stdout
    assert "Traceback" not in done.stdout


@pytest.mark.slow
def test_pytest_names_what_there_is_not(site: Site) -> None:
    done = pytest_says("--auvbench", "algo=nobody")
    assert done.returncode == 4
    assert "--auvbench 'algo=nobody': algo=nobody: no such option" in done.stderr + done.stdout


def test_the_plug_in_costs_nothing_where_it_is_not_used() -> None:
    code = "import sys; before = set(sys.modules); import pytest; own = set(sys.modules); import pytest_auvbench; "
    code += "print(sorted({n.partition('.')[0] for n in set(sys.modules) - own} - {'pytest_auvbench'}))"
    root = str(Path(__file__).parents[3])
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root)
    assert done.stdout == "[]\n"


def test_a_misspelt_name_is_an_error_of_the_configuration() -> None:
    with pytest.raises(ConfigError, match="no such option"):
        testing.check_agent("algo=pidd")
