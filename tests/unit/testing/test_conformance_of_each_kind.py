"""auvbench's own blocks, rewards, launchers, trackers and commands keep their contracts; one that breaks its contract is found."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from auvbench import testing
from auvbench.config.rewards import suitable
from auvbench.errors import ConfigError
from auvbench.registry import BLOCKS, COMMANDS, REWARDS, TASKS
from auvbench.testing import ConformanceError, blocks, commands, launchers, rewards, trackers
from tests.packages import Site, site, tasking
from tests.unit.tasks.test_blocks import SEEN, measuring

__all__ = ["site"]

HEAVY = "vehicle=bluerov2_heavy"
STATION = ("task=station_keeping", "reward=view", HEAVY)


def named(check: Callable[..., None]) -> str:
    return check.__name__


@pytest.mark.parametrize("task", ["waypoint", "path_following", "docking"])
@pytest.mark.slow
def test_our_blocks(task: str) -> None:
    """These tasks have all blocks."""
    names = [name for name in BLOCKS.own if name in TASKS[task].blocks]
    preview = ["task.preview.points=2"] if "preview" in names else []
    testing.check_block(f"task={task}", HEAVY, f"task.observation=[{','.join(names)}]", *preview)


@pytest.mark.parametrize("check", testing.BLOCK_CHECKS, ids=named)
@pytest.mark.slow
def test_the_block_of_the_example(site: Site, check: Callable[..., None]) -> None:
    measuring(site)
    testing.check_block(SEEN, only=check)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("check", "change", "message"),
    [
        (blocks.its_numbers_are_finite_and_within_bounds, ("u + SIGMA * nu", "99.0"), "write gives doppler_x=99; it must be within [-50, 50]"),
        (blocks.its_numbers_do_not_depend_on_the_batch, ("u + SIGMA * nu", "u + 1.0 * e.environment / (1.0 + len(SEEN) * 0.0)"), "cannot be compiled"),
        (blocks.it_stays_within_its_arrays, ("    u, v, w = m.velocity\n", "    u, v, w = m.velocity\n    out[3] = 0.0\n"), "run as Python: task.observation=doppler of dopplers==1.0: write fails: IndexError"),
        (blocks.it_changes_nothing_that_it_reads, ("    u, v, w = m.velocity\n", "    u, v, w = m.velocity\n    e.distance += 1.0\n"), "it changes the episode"),
        (blocks.a_pilot_observes_it, ("m.velocity", "m.velocity if e.steps >= 0 else m.rates"), "a pilot cannot call it: AttributeError"),
    ],
)  # fmt: skip
def test_a_block_that_breaks_its_contract(
    site: Site, check: Callable[..., None], change: tuple[str, str], message: str
) -> None:
    measuring(site, change)
    with pytest.raises(ConformanceError) as raised:
        testing.check_block(SEEN, only=check)
    assert message in str(raised.value)
    assert str(raised.value).startswith(f"{SEEN}: {check.__name__.replace('_', ' ')}: ")


@pytest.mark.slow
@pytest.mark.parametrize("reward", REWARDS.own)
def test_our_rewards(reward: str) -> None:
    task = next(task for task in TASKS.own if reward in suitable(task))
    testing.check_reward(f"task={task}", f"reward={reward}", HEAVY)


@pytest.mark.slow
def test_the_reward_of_the_example(site: Site) -> None:
    tasking(site)
    testing.check_reward(*STATION)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("check", "change", "message"),
    [
        (rewards.its_numbers_do_not_depend_on_the_batch, ("p.k * (seen -", "p.k * (e.environment + math.nan * seen -"), "the reward is not finite"),
        (rewards.it_pays_every_end, ("math.exp(-e.to_go / p.length)", "1.0 / e.to_go"), "it pays every end: "),
        (rewards.it_pays_every_end, ("math.exp(-e.to_go / p.length)", "min(1.0, e.to_go * e.to_go * math.inf if e.to_go > 1e3 else 1.0) * math.nan ** (e.to_go > 1e3)"), "10000 m from the reference, gives the reward nan"),
        (rewards.it_changes_nothing_that_it_reads, ("    seen = ", "    e.energy += 1.0\n    seen = "), "it changes the episode"),
        (rewards.it_changes_nothing_that_it_reads, ("    seen = ", "    v.action[0] = 0.0\n    seen = "), "it changes the action"),
        (rewards.it_stays_within_its_arrays, ("    seen = ", "    seen = 0.0 * v.action[len(v.action)] + "), "run as Python: "),
    ],
)  # fmt: skip
def test_a_reward_that_breaks_its_contract(
    site: Site, check: Callable[..., None], change: tuple[str, str], message: str
) -> None:
    tasking(site, change)
    with pytest.raises(ConformanceError) as raised:
        testing.check_reward(*STATION, only=check)
    assert message in str(raised.value)


@pytest.mark.slow
@pytest.mark.parametrize("check", testing.LAUNCHER_CHECKS, ids=named)
def test_our_launcher_on_this_machine(check: Callable[..., None]) -> None:
    testing.check_launcher("launcher=local", "launcher.workers=1", only=check)


LAUNCHER = """
    from pathlib import Path
    from auvbench.plugin import LauncherSpec
    from auvbench.scheduling.loop import Phase, Status
    from auvbench.training.worker import work

    class Job:
        mark = None

        def __init__(self, run, code):
            self.run, self.status = run, Status(Phase.ENDED, code)

        def poll(self):
            return self.status

        def cancel(self, *, force=False):
            pass

    class Backend:
        limit = 1

        def __init__(self, target):
            self.target = target

        def submit(self, run):
            try:
                return Job(run, work(run, target=self.target))
            except Exception:
                return Job(run, 1)

        def adopt(self, run):
            return None

        def wait(self, seconds):
            pass

        def close(self):
            pass

    def make(options, target, learning):
        return Backend(target)

    SPEC = LauncherSpec("inline", "inline:make")
"""


def launching(site: Site, *changes: tuple[str, str]) -> None:
    text = textwrap.dedent(LAUNCHER)
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    files = {
        "inline.py": text,
        "inline_conf/__init__.py": "",
        "inline_conf/launcher/inline.yaml": "name: inline\n",
    }
    points = {"auvbench.launchers": {"inline": "inline:SPEC"}}
    site.install("in-line", files, points=points, conf="inline_conf")


@pytest.mark.slow
def test_a_launcher_that_keeps_its_contract(site: Site) -> None:
    launching(site)
    testing.check_launcher("launcher=inline")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("check", "change", "message"),
    [
        (launchers.it_carries_runs_out, ("work(run, target=self.target)", "0"), "a run's state is pending, and its job ended with exit code 0"),
        (launchers.it_carries_runs_out, ("self.run, self.status = run,", "self.run, self.status = run.parent,"), "returns a job of the run"),
        (launchers.it_reports_a_run_that_fails, ("work(run, target=self.target))", "0 * work(run, target=self.target))"), "without a run ended with exit code 0"),
        (launchers.an_ended_job_stays_as_it_is, ("        pass\n\nclass Backend", "        self.status = Status(Phase.ENDED, 7)\n\nclass Backend"), "cancel must not change an ended job"),
        (launchers.an_ended_job_stays_as_it_is, ("        return None", "        return Job(run, 0)"), "for a run that has ended; it must return None"),
        (launchers.it_closes_twice, ("    def close(self):\n        pass", "    def close(self):\n        del self.target"), "it closes twice: the launcher fails: AttributeError"),
    ],
)  # fmt: skip
def test_a_launcher_that_breaks_its_contract(
    site: Site, check: Callable[..., None], change: tuple[str, str], message: str
) -> None:
    launching(site, change)
    with pytest.raises(ConformanceError) as raised:
        testing.check_launcher("launcher=inline", only=check)
    assert message in str(raised.value)


TRACKER = """
    from auvbench.plugin import TrackerSpec

    class Run:
        def write(self, scalars, step):
            print(step, dict(scalars))

        def close(self, error):
            print(error)

    def prepare(experiment):
        print(experiment)

    def start(key, config, name):
        return Run()

    def table(name, csv, files):
        print(name, csv, [file.read_text() for file in files])

    SPEC = TrackerSpec("printed", "printed")
"""


def tracking(site: Site, *changes: tuple[str, str]) -> None:
    text = textwrap.dedent(TRACKER)
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    site.install("print-log", {"printed.py": text}, points={"auvbench.trackers": {"printed": "printed:SPEC"}})


def test_a_tracker_that_keeps_its_contract(site: Site) -> None:
    tracking(site)
    testing.check_tracker("printed")


@pytest.mark.parametrize(
    ("check", "change", "message"),
    [
        (trackers.it_logs_a_training, ("print(step, dict(scalars))", "[int(value) for value in scalars.values()]"), "write fails: ValueError: cannot convert float NaN"),
        (trackers.it_logs_a_training, ("        print(error)", "        import random; random.random()"), "logging must not draw from the global generator of random"),
        (trackers.an_attempt_continues_the_log_of_an_earlier_one, ("    return Run()", "    global seen; assert 'seen' not in globals(); seen = 1; return Run()"), "start, close, and start with the same key fails: AssertionError"),
        (trackers.it_changes_nothing_that_it_gets, ("    return Run()", "    config.pop('algo'); return Run()"), "start changes the configuration of the run"),
        (trackers.it_changes_nothing_that_it_gets, ("print(step, dict(scalars))", "scalars.clear()"), "write changes the scalars of the run"),
        (trackers.it_logs_a_table, ("[file.read_text() for file in files]", "[file.unlink() for file in files]"), "table changes a file of the report"),
    ],
)  # fmt: skip
def test_a_tracker_that_breaks_its_contract(
    site: Site, check: Callable[..., None], change: tuple[str, str], message: str
) -> None:
    tracking(site, change)
    with pytest.raises(ConformanceError) as raised:
        testing.check_tracker("printed", only=check)
    assert message in str(raised.value)
    assert str(raised.value).startswith("train.log=printed: ")


@pytest.mark.slow
@pytest.mark.parametrize("service", ["wandb", "mlflow"])
def test_our_trackers(service: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip(service)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WANDB_ERROR_REPORTING", "false")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path}/mlflow.db")
    testing.check_tracker(service)


@pytest.mark.slow
@pytest.mark.parametrize("check", testing.COMMAND_CHECKS[:3], ids=named)
@pytest.mark.parametrize("command", COMMANDS.own)
def test_our_commands(command: str, check: Callable[..., None]) -> None:
    testing.check_command(command, only=check)


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS.own)
def test_importing_our_commands_does_nothing(command: str) -> None:
    testing.check_command(command, only=commands.importing_it_does_nothing)


COMMAND = """
    from auvbench.grammar import Parser
    from auvbench.plugin import CommandSpec

    def main(words):
        parser = Parser(prog="auvbench hello", description="Says hello.")
        parser.read(words)
        print("hello")

    SPEC = CommandSpec("hello", "say hello", "hello:main")
"""


def commanding(site: Site, *changes: tuple[str, str]) -> None:
    text = textwrap.dedent(COMMAND)
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    site.install("greeting", {"hello.py": text}, points={"auvbench.commands": {"hello": "hello:SPEC"}})


def test_a_command_that_keeps_its_contract(site: Site) -> None:
    commanding(site)
    testing.check_command("hello")


@pytest.mark.parametrize(
    ("check", "change", "message"),
    [
        (commands.its_title_is_one_line, ('"say hello"', '"say\\nhello"'), "must be one line of at most 100 characters"),
        (commands.its_help_ends_well, ("    parser.read(words)\n", "    return 3\n"), "auvbench hello --help must print help and end with exit code 0, not 3"),
        (commands.its_help_ends_well, ("    parser.read(words)\n", "    open('hello.txt', 'w').close()\n"), "auvbench hello --help writes hello.txt"),
        (commands.an_unknown_option_is_one_line, ("    parser.read(words)\n", ""), "--no-such-option must end with exit code 2 and one line of error, not 0"),
        (commands.an_unknown_option_is_one_line, ("    parser.read(words)\n", "    raise ValueError('no')\n"), "must end with exit code 2 and one line of error, not 1"),
        (commands.importing_it_does_nothing, ("SPEC =", "print('hello')\nSPEC ="), "importing hello says 'hello'"),
        (commands.importing_it_does_nothing, ("SPEC =", "open('hello.txt', 'w').close()\nSPEC ="), "importing hello writes hello.txt"),
    ],
)  # fmt: skip
def test_a_command_that_breaks_its_contract(
    site: Site, check: Callable[..., None], change: tuple[str, str], message: str
) -> None:
    commanding(site, change)
    with pytest.raises(ConformanceError) as raised:
        testing.check_command("hello", only=check)
    assert message in str(raised.value)
    assert str(raised.value).startswith("auvbench hello: ")


def test_unknown_names_are_errors_of_the_configuration() -> None:
    with pytest.raises(ConfigError, match="command=trian: unknown; did you mean 'train'"):
        testing.check_command("trian")
    with pytest.raises(ConfigError, match=r"train\.log=printed: unknown"):
        testing.check_tracker("printed")


def test_each_kind_has_a_suite() -> None:
    suites: dict[str, Any] = {**testing.SUITES, **testing.NAMED}
    assert set(suites) == {
        "task=",
        "reward=",
        "task.observation=",
        "disturbance=",
        "simulator=",
        "launcher=",
        "train.log=",
        "command=",
    }
    for checks, _ in suites.values():
        assert all(check.__doc__ for check in checks)
