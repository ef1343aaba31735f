"""Tasks and rewards of installed packages: chosen, checked, measured, and refused in one line."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import auvbench
from auvbench import cli, metrics
from auvbench.config import complete
from auvbench.config.compose import compose, typed
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.errors import AgentError
from auvbench.record import measure_names, record_columns
from auvbench.registry import REWARDS, TASKS
from auvbench.testing import ConformanceError, check_task
from auvbench.testing.tasks import its_functions_stay_within_their_arrays
from tests.packages import Site, site, tasking

__all__ = ["site"]

CIRCLING = ("task=circling", "vehicle=bluerov2_heavy")


def batch(*overrides: str, n: int = 2, interpreted: bool = False) -> Batch:
    made = Batch(train_config(compose("train", overrides)), n, seed=3)
    if interpreted:  # far quicker than to compile what is wrong
        made.task.interpret()
    return made


def steps(one: Batch, count: int) -> list[np.ndarray]:
    one.reset()
    rng = np.random.default_rng(0)
    shape = (one.n, len(one.vehicle.actuators))
    return [one.step(rng.uniform(-1.0, 1.0, shape)).reward.copy() for _ in range(count)]


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """The one line with which a command ends with exit code 2."""
    assert cli.main(list(words)) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1, error
    return error


@pytest.mark.slow
def test_it_is_chosen_with_its_reward_its_types_and_its_package(site: Site) -> None:
    tasking(site)
    config = train_config(compose("train", [*CIRCLING, "task.radius=4"]))
    assert type(config.task).__name__ == "CirclingConfig"
    assert (config.task.radius, config.task.package) == (4.0, "auvbench-example==1.0")
    assert (config.reward.name, config.reward.package) == ("view", "auvbench-example==1.0")
    assert complete.releases(config) == {"auvbench-example": "1.0"}
    assert complete.releases({"algo": {}, "reward": {"package": "auvbench-example==1.0"}}) == {
        "auvbench-example": "1.0"
    }
    assert TASKS["circling"].title == "circling a pole"
    assert record_columns("circling")[-2:] == ("in_view", "closest_m")
    assert set(metrics.SHARED) < set(record_columns("circling"))


@pytest.mark.slow
def test_a_new_metric_of_a_package_touches_the_file_of_its_task_only(site: Site) -> None:
    line = 'column("closest_m", "m", "closest", "least distance to the axis of the pole", "higher"),'
    more = 'column("turned_rad", "rad", "turned", "way round the pole", "higher"),'
    tasking(
        site,
        (line, f"{line}\n        {more}"),
        ('"closest_m": e.closest', '"closest_m": e.closest, "turned_rad": e.turn + 2.0'),
    )
    one = batch(*CIRCLING, "task.time_limit=0.2", interpreted=True)
    one.reset()
    one.step(np.zeros((2, 8)))
    turned = (one.task.episodes.turn + 2.0).tolist()
    assert [record["turned_rad"] for record in one.step(np.zeros((2, 8))).records] == turned
    assert "mean_turned_rad" in measure_names()
    assert "| `turned_rad` | rad | higher | way round the pole |" in metrics.definitions()
    assert "turned_rad" not in record_columns("docking")


@pytest.mark.slow
def test_what_it_entered_is_gone_when_it_is_forgotten(site: Site) -> None:
    before = metrics.registered()
    tasking(site)
    compose("train", CIRCLING)
    assert len(metrics.registered()) == len(before) + 2
    site.look_again()
    assert before == metrics.registered()
    assert "circling" not in TASKS
    assert not REWARDS.entered


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("reward=thesis",),
            "reward.name=thesis: is not available for task=circling; use reward=view or tracking",
        ),
        (("task.radius=-1",), "task.radius=-1: must be more than 0"),
        (("task.raduis=1",), "task.raduis: unknown key; did you mean task.radius?"),
        (("reward.effort=x",), "reward.effort: 'x' is not a number"),
        (("task.observation=[preview]",), "preview is not a block of task=circling"),
        (("task.centre=[0,0]",), "task.centre=[0.0, 0.0]: must be three finite numbers"),
        (("+task.package=x",), "task.package=x: auvbench sets it (auvbench-example==1.0)"),
        (("vehicle=lrauv",), "task=circling: asks for thrust along x, y, z"),
        (("task=waypoint", "reward=view"), "reward.name=view: is not available for task=waypoint"),
        (("task=circlin",), "did you mean 'circling'?"),
    ],
)
def test_what_is_typed_wrong_is_one_line(
    site: Site, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], message: str
) -> None:
    tasking(site)
    assert message in refused(capsys, "train", "algo=pid", *CIRCLING, *words)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("SPEC = TaskSpec(", "SPEC = dict("), "is a dict; it must be an auvbench.plugin.TaskSpec"),
        (('name="circling"', 'name="round"'), "has the name 'round'; it must have the name of its entry point"),
        (("schema=CirclingConfig", "schema=int"), "has a schema that is not a dataclass derived from auvbench.plugin.TaskConfig"),
        (("blocks=ERRORS", 'blocks=("yaw",)'), "declares the block 'yaw'"),
        (('"timeout", "out_of', '"late", "out_of'), "declares the outcome 'late'"),
        (("mean_in_view", "mean_inview"), "is ranked by 'mean_inview', which is not a measure; did you mean 'mean_in_view'?"),
        (('"closest_m",', '"energy_J",'), "has the metric energy_J, a name that another metric has"),
        (("SPEC = TaskSpec(", "SPEC = TaskSpec(free_goal=True,"), "has a free goal without a fixed start"),
        (("high=1.0", "high=-1.0"), "as a metric; must be a result of auvbench.plugin.column"),
        (("effort: float = number(0.0, 1e3)", "effort: list[float]"), "has the parameter effort, which is not a number"),
    ],
)  # fmt: skip
def test_what_is_declared_wrong_is_one_line(
    site: Site, capsys: pytest.CaptureFixture[str], change: tuple[str, str], message: str
) -> None:
    tasking(site, change)
    error = refused(capsys, "train", "algo=pid", *CIRCLING)
    assert message in error
    assert "of auvbench-example==1.0" in error


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("e.closest = min(e.closest, away)", "e.closest = math.nan"), "step writes closest, which is not finite, in environment 0 at step 1 of its episode 0"),
        (("angle = e.angle +", "angle = math.nan *"), "draw gives no start: it must write finite numbers to e.start"),
        (("rate * time", "rate * (time if time == 0.0 else math.nan)"), "step writes reference, which is not finite"),
        (("    start_in_ball(e, p.start_radius, p, u, v, w)\n", ""), "draw gives no start"),
        (("e.closest = p.radius + p.bounds", "e.closest = math.nan"), "draw writes closest, which is not finite"),
        (("    return GOES_ON\n", "    return 7\n"), "step returns an unknown outcome"),
        (("add_errors(e)\n", "add_errors(e)\n    e.sean += 1.0\n"), "step fails: AttributeError"),
        (("    success_ends = False", "    own_parameters = lambda self, task: {'x': math.nan}\n    success_ends = False"), "the parameter x is nan; it must be a number"),
        (("    success_ends = False", "    own_parameters = lambda self, task: {'x': 'y'}\n    success_ends = False"), "its parameters must be numbers or lists of numbers"),
        (('("seen", "f8")', '("a b", "f8")'), "a b cannot be the name of a field; use a Python name other than view"),
        (('("seen", "f8")', '("steps", "f8")'), "the field steps occurs twice"),
        (('("seen", "f8")', '("seen", "number")'), "its fields must be (name, type) or (name, type, shape)"),
        (("    step = staticmethod(step)\n", ""), "CirclingTask must define step, a function of one episode"),
        (("circling:CirclingTask", "circling:SPEC"), "its factory is not a subclass of auvbench.tasks.base.Task"),
        (("circling:CirclingTask", "circling:Cycling"), "cannot be imported: AttributeError"),
    ],
)  # fmt: skip
def test_what_is_computed_wrong_names_the_task(site: Site, change: tuple[str, str], message: str) -> None:
    tasking(site, change)
    with pytest.raises(AgentError) as raised:
        steps(batch(*CIRCLING, interpreted=True), 1)
    assert "task=circling of auvbench-example==1.0" in str(raised.value)
    assert message in str(raised.value)


@pytest.mark.slow
def test_what_cannot_be_compiled_is_one_line_with_its_place(site: Site) -> None:
    tasking(site, ("e.seen += 1.0", "e.seen += 'one'"))
    with pytest.raises(AgentError) as raised:
        steps(batch(*CIRCLING), 1)
    assert "step fails: it cannot be compiled (circling.py, line " in str(raised.value)
    assert "No implementation of function" in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('"closest_m": e.closest', '"closest": e.closest'), "own_metrics lacks closest_m"),
        (
            ('"closest_m": e.closest', '"closest_m": math.nan'),
            "closest_m of episode 0 is nan; it must be finite",
        ),
    ],
)
def test_a_wrong_record_names_the_task(site: Site, change: tuple[str, str], message: str) -> None:
    tasking(site, change)
    with pytest.raises(AgentError, match=message):
        steps(batch(*CIRCLING, "task.time_limit=0.2", interpreted=True), 2)


@pytest.mark.slow
def test_a_schema_refuses_values_and_lengths(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    check = """
    def check(self):
        if self.start_radius > self.radius:
            raise ConfigError(f"task.start_radius={self.start_radius:g}: must be at most task.radius")

    def check_length(self, frequency):
        if self.max_steps < frequency:
            raise ConfigError(f"task.max_steps={self.max_steps}: must be at least a second")

"""
    tasking(
        site,
        ("    share: float = number(0.0, 1.0)\n", f"    share: float = number(0.0, 1.0)\n{check}"),
        ("from auvbench.plugin import ERRORS", "from auvbench.plugin import ERRORS, ConfigError"),
    )
    words = ("train", "algo=pid", *CIRCLING)
    wide = "task.start_radius=900: must be at most task.radius"
    assert wide in refused(capsys, *words, "task.start_radius=900")
    short = ("task.time_limit=null", "task.max_steps=3")
    assert "task.max_steps=3: must be at least a second" in refused(capsys, *words, *short)


@pytest.mark.slow
def test_a_reward_that_is_not_finite_is_named_on_a_task_of_auvbench(site: Site) -> None:
    tasking(site, ("seen = ", "seen = math.nan * "))
    with pytest.raises(AgentError, match="reward=view of auvbench-example"):
        steps(batch("task=station_keeping", "reward=view", "vehicle=bluerov2_heavy"), 1)


@pytest.mark.slow
def test_a_reward_gets_the_numbers_that_auvbench_s_own_get(site: Site) -> None:
    """The formula of `reward=exponential` as one of a package gives the same floats."""
    tasking(
        site,
        ("return p.k * p.failure", "return p.failure"),
        ("max(0.0, math.cos(e.yaw_error)) * math.exp(-e.to_go / p.length)", "math.exp(-p.length * e.to_go)"),
        ("p.k * (seen - p.effort * effort(v) / len(v.action))", "p.k * seen"),
        ("length: 1.0 ", "length: 2.0 "),
        ("failure: -10.0", "failure: -1.0"),
    )  # fmt: skip
    place = ("task=station_keeping", "vehicle=bluerov2_heavy", "task.bounds=3")
    own = steps(batch(*place, "reward=exponential", n=5), 60)
    theirs = steps(batch(*place, "reward=view", n=5), 60)
    assert len({float(r) for step in own for r in step}) > 100
    assert np.array_equal(own, theirs)


@pytest.mark.slow
def test_a_copy_is_checked_and_goes_on_by_itself(site: Site) -> None:
    tasking(site)
    one = batch(*CIRCLING)
    one.reset()
    for other in (copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        other.step(np.zeros((2, 8)))
        assert one.task.episodes.steps.tolist() == [0, 0]
        assert other.task.episodes.steps.tolist() == [1, 1]
        other.task.parameters["centre"] = np.nan
        with pytest.raises(AgentError, match="task=circling of auvbench-example"):
            other.step(np.zeros((2, 8)))


@pytest.mark.slow
def test_the_example_keeps_its_contract(site: Site) -> None:
    tasking(site)
    check_task(*CIRCLING)


@pytest.mark.slow
def test_an_index_that_is_too_large_is_found(site: Site) -> None:
    tasking(
        site,
        ('("seen", "f8")', '("seen", "f8", (2,))'),
        ("e.seen += 1.0", "e.seen[e.steps] += 1.0"),
        ("p.field_of_view and", "9.0 and"),
        ("p.tolerance:", "1e9:"),
        ("e.seen >=", "e.seen.sum() >="),
        ("in_view = e.seen /", "in_view = e.seen.sum() /"),
    )
    with pytest.raises(ConformanceError, match="out of bounds"):
        check_task(*CIRCLING, only=its_functions_stay_within_their_arrays)


@pytest.mark.slow
def test_another_version_of_its_package_is_one_line(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    tasking(site)
    assert cli.main(["train", "algo=pid", *CIRCLING]) == 0
    capsys.readouterr()
    tasking(site, version="1.1")
    assert cli.main(["evaluate", "outputs"]) == 2
    message = "task.name=circling: comes with auvbench-example==1.0, and auvbench-example==1.1 is installed"
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_a_task_that_fails_gives_a_failed_run_and_the_others_are_kept(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    tasking(site, ('("seen", "f8")', '("seen", "number")'))
    assert (
        cli.main(["train", "-m", "task=circling,station_keeping", "vehicle=bluerov2_heavy", "algo=pid"]) == 1
    )
    said = "".join(capsys.readouterr())
    assert "its fields must be (name, type)" in said
    assert "Traceback" not in said
    states = {
        path.parent.name.split("-")[2]: path.read_text() for path in Path("outputs").glob("*/*/manifest.json")
    }
    assert '"state": "failed"' in states["circling"]
    assert '"state": "complete"' in states["station_keeping"]


@pytest.mark.slow
def test_a_run_whose_package_is_gone_is_one_line(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    tasking(site)
    assert cli.main(["train", "algo=pid", *CIRCLING]) == 0
    capsys.readouterr()
    site.uninstall("auvbench-example")
    gone = "task.name=circling: comes with auvbench-example==1.0, and is not installed"
    assert gone in refused(capsys, "report", "outputs")
    assert cli.main(["evaluate", "outputs"]) == 2
    assert gone in capsys.readouterr().err


@pytest.mark.slow
def test_gymnasium_makes_it(site: Site) -> None:
    tasking(site)
    auvbench.register()
    try:
        env = gymnasium.make("auvbench/Circling-v0", vehicle="bluerov2_heavy")
        observation, info = env.reset(seed=1)
        assert observation.shape == (24,)
        assert info["reference"].shape == (3,)
    finally:
        del gymnasium.registry["auvbench/Circling-v0"]


@pytest.mark.slow
def test_a_frozen_configuration_is_read_again(site: Site) -> None:
    tasking(site)
    config = compose("train", [*CIRCLING, "task.radius=4"])
    site.look_again()
    assert typed(config).task.radius == 4.0
    assert TASKS["circling"].primary == "mean_in_view"
