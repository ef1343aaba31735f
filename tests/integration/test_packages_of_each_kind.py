"""Disturbances, simulators, launchers, trackers and commands of installed packages: chosen, used, and refused in one line."""

from __future__ import annotations

import copy
import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from omegaconf import OmegaConf

from auvbench import cli, tracking
from auvbench.commands.completion import candidates
from auvbench.config.complete import releases
from auvbench.config.compose import compose, typed
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.errors import AgentError, ConfigError
from auvbench.registry import COMMANDS, KINDS, LAUNCHERS, SIMULATORS, TRACKERS
from auvbench.runs.directory import RunDirectory
from auvbench.runs.identity import run_id
from auvbench.testing import ConformanceError, check_disturbance, check_simulator
from auvbench.testing.disturbances import (
    it_changes_the_motion_or_the_readings,
    its_functions_stay_within_their_arrays,
)
from auvbench.testing.simulators import its_state_comes_back, motion_is_deterministic
from tests import synthetic
from tests.packages import Site, site

__all__ = ["site"]

EXAMPLE = Path(__file__).parents[2] / "examples/auvbench-example/auvbench_example"
STILL = (Path(__file__).parents[2] / "examples" / "still.py").read_text(encoding="utf-8")
STILL_YAML = "name: still\ndrift: 0.5\n"

INLINE = """
    from dataclasses import dataclass
    from pathlib import Path
    from auvbench.plugin import LauncherConfig, LauncherSpec
    from auvbench.scheduling.loop import Phase, Status
    from auvbench.training.worker import work

    @dataclass(kw_only=True)
    class InlineConfig(LauncherConfig):
        note: str

    class Job:
        mark = None

        def __init__(self, run, code):
            self.run, self.code = run, code

        def poll(self):
            return Status(Phase.ENDED, self.code)

        def cancel(self, *, force=False):
            pass

    class Backend:
        limit = 1

        def __init__(self, options, target):
            self.options, self.target = options, target

        def submit(self, run):
            Path("note.txt").write_text(self.options.note)
            return Job(run, work(run, target=self.target))

        def adopt(self, run):
            return None

        def wait(self, seconds):
            pass

        def close(self):
            pass

    def make(options, target, learning):
        return Backend(options, target)

    SPEC = LauncherSpec("inline", "inline:make", InlineConfig)
"""
INLINE_YAML = "name: inline\nnote: hello\n"

FILE_LOG = """
    import json
    from pathlib import Path
    from auvbench.plugin import TrackerSpec

    LOG = Path("log.jsonl")

    def _write(*values):
        with LOG.open("a") as file:
            file.write(json.dumps(values) + "\\n")

    class Run:
        def write(self, scalars, step):
            _write("write", step, sorted(scalars))

        def close(self, error):
            _write("close", repr(error))

    def prepare(experiment):
        _write("prepare", experiment)

    def start(key, config, name):
        _write("start", key, config["name"], name)
        return Run()

    def table(name, csv, files):
        _write("table", name, csv.splitlines()[0], [path.name for path in files])

    SPEC = TrackerSpec("filelog", "filelog")
"""

HELLO = """
    from auvbench.plugin import CommandSpec

    def main(words):
        if "fail" in words:
            raise ValueError("no such word")
        print("hello", *words)
        return 3 if words else None

    SPEC = CommandSpec("hello", "say hello", "hello:main")
"""


def simulating(site: Site, *changes: tuple[str, str], version: str = "1.0") -> None:
    text = STILL
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    files = {"still.py": text, "still_conf/__init__.py": "", "still_conf/simulator/still.yaml": STILL_YAML}
    points = {"auvbench.simulators": {"still": "still:SPEC"}}
    site.install("still-water", files, points=points, conf="still_conf", version=version)


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """The one line with which a command ends with exit code 2."""
    assert cli.main(list(words)) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1, error
    return error


def batch(*overrides: str) -> Batch:
    return Batch(train_config(compose("train", ["algo=pid", *overrides])), 2, seed=1)


def test_auvbench_s_own_lines_name_their_specs() -> None:
    for kind in KINDS:
        for name in kind.own:
            spec = kind[name]
            assert isinstance(spec, kind.spec)
            assert spec.name == name
            module = spec.code.partition(":")[0]
            assert importlib.util.find_spec(module) is not None, module
        assert list(kind) == list(kind.own)
        assert len(kind) == len(kind.own)
        with pytest.raises(KeyError):
            kind["nothing of this name"]


@pytest.mark.slow
def test_a_simulator(site: Site) -> None:
    simulating(site)
    environments = batch("simulator=still", "simulator.drift=0.25")
    assert environments.config.simulator.package == "still-water==1.0"
    environments.reset()
    before = environments.simulator.pose.copy()
    environments.step(environments._action)
    moved = environments.simulator.pose - before
    assert moved[:, 0] == pytest.approx(0.25 * environments.task.duration)
    assert not moved[:, 1:].any()
    state = environments.state_dict()
    environments.step(environments._action)
    environments.load_state_dict(state)
    assert (environments.simulator.pose == before + moved).all()
    other = copy.deepcopy(environments)
    other.step(other._action)
    assert (environments.simulator.pose == before + moved).all()
    assert (other.simulator.pose == before + 2 * moved).all()


@pytest.mark.slow
def test_a_simulator_that_keeps_its_contract_and_one_that_does_not(site: Site) -> None:
    simulating(site)
    check_simulator("algo=pid", "simulator=still", only=motion_is_deterministic)
    check_simulator("algo=pid", "simulator=still", only=its_state_comes_back)
    simulating(site, ('return {"pose": self.pose.copy()}', 'return {"pose": self.pose[:] * 0}'))
    with pytest.raises(ConformanceError, match="from its state_dict on"):
        check_simulator("algo=pid", "simulator=still", only=its_state_comes_back)


@pytest.mark.slow
def test_a_simulator_s_package_is_part_of_a_run_s_identity(site: Site) -> None:
    def frozen() -> dict[str, Any]:
        plain = OmegaConf.to_container(compose("train", ["algo=pid", "simulator=still"]), resolve=True)
        assert isinstance(plain, dict)
        return {str(key): value for key, value in plain.items()}

    simulating(site)
    first = frozen()
    simulating(site, version="2.0")
    assert run_id(first) != run_id(frozen())
    with pytest.raises(
        ConfigError, match=r"comes with still-water==1\.0, and still-water==2\.0 is installed"
    ):
        typed(OmegaConf.create(first))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("simulator.drift=2",), "simulator.drift=2: must be at least 0 and at most 1"),
        (("simulator.drfit=1",), "simulator.drfit: unknown key; did you mean simulator.drift?"),
        (
            ("disturbance=current",),
            "needs a steady current, which simulator=still does not have as configured; use",
        ),
        (("simulator=stil",), "did you mean 'still'?"),
    ],
)
def test_what_is_typed_wrong_of_a_simulator_is_one_line(
    site: Site, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], message: str
) -> None:
    simulating(site)
    assert message in refused(capsys, "train", "algo=pid", "simulator=still", *words)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("SimulatorSpec(\"still\", \"still:make\", CAN", "SimulatorSpec(\"still\", \"still:make\", 3"), "has invalid capabilities"),
        (("CAN, StillConfig)", "CAN, int)"), "has a schema that is not a dataclass derived from auvbench.plugin.SimulatorConfig"),
        (("SPEC = SimulatorSpec(", "SPEC = dict(a="), "cannot be imported"),
    ],
)  # fmt: skip
def test_what_a_simulator_declares_wrong_is_one_line(
    site: Site, capsys: pytest.CaptureFixture[str], change: tuple[str, str], message: str
) -> None:
    simulating(site, change)
    error = refused(capsys, "train", "algo=pid", "simulator=still")
    assert message in error
    assert "of still-water==1.0" in error


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("self.pose[:, 0] += ", "self.pose[1, 0] = float('nan') * "), "step writes a number that is not finite into pose of vehicle 1"),
        (("self.drift = drift\n", "self.power = [0.0]\n"), "power is list; it must be float64 (2,)"),
        (("self.drift = drift\n", "self.pose = self.pose[:, :3]\n"), "pose is float64 (2, 3); it must be float64 (2, 7)"),
        (("self.pose[:, 0] += ", "self.nothing += "), "step fails: AttributeError"),
        (("return Still(", "return dict("), "cannot be made: TypeError"),
        (("return Still(vehicle, n, settings.drift)", "return 3"), "a int, which lacks reset"),
    ],
)  # fmt: skip
def test_what_a_simulator_computes_wrong_is_named(site: Site, change: tuple[str, str], message: str) -> None:
    simulating(site, change)

    def step_once() -> None:
        environments = batch("simulator=still")
        environments.reset()
        environments.step(environments._action)

    with pytest.raises(AgentError) as raised:
        step_once()
    assert "simulator=still of still-water==1.0: " in str(raised.value)
    assert message in str(raised.value)


SURGE = EXAMPLE.joinpath("surge.py").read_text(encoding="utf-8").replace("auvbench_example.surge", "surge")
SURGE_YAML = "defaults: [none, _self_]\nname: surge\nsurge: {force: 10.0, period: 5.0}\n"


def surging(site: Site, *changes: tuple[str, str], version: str = "1.0") -> None:
    text = SURGE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    files = {"surge.py": text, "surge_conf/__init__.py": "", "surge_conf/disturbance/surge.yaml": SURGE_YAML}
    points = {"auvbench.disturbances": {"surge": "surge:SPEC"}}
    site.install("swell", files, points=points, conf="surge_conf", version=version)


@pytest.mark.slow
def test_a_disturbance(site: Site) -> None:
    surging(site)
    pushed = batch("disturbance=surge", "disturbance.surge.force=20", "disturbance.delay.action=0.05")
    assert pushed.config.disturbance.surge.package == "swell==1.0"
    assert list(pushed.disturbances.parts) == ["delay", "surge"]
    pushed.reset()
    phase = pushed.disturbances["surge"].state.phase
    assert 0.0 < phase[0] < 1.0
    assert phase[0] != phase[1]
    pushed.step(pushed._action)
    assert pushed.simulator.external_wrench[:, 0] == pytest.approx(20.0 * np.sin(2.0 * np.pi * phase))
    before = pushed.simulator.pose.copy()
    other = copy.deepcopy(pushed)
    other.step(other._action)
    assert (pushed.simulator.pose == before).all()
    assert (other.simulator.pose != before).any()
    assert batch("disturbance=surge", "disturbance.surge.force=0").disturbances is None


@pytest.mark.slow
def test_a_disturbance_is_added_to_any_other(site: Site) -> None:
    surging(site)
    both = batch("disturbance=severe", "+disturbance.surge={force: 20, period: 5}")
    assert list(both.disturbances.parts) == ["current", "fault", "delay", "sensor", "randomisation", "surge"]


@pytest.mark.slow
def test_a_disturbance_that_keeps_its_contract_and_one_that_does_not(site: Site) -> None:
    surging(site)
    check_disturbance("disturbance=surge", "noise=none")
    surging(
        site,
        ('("phase", "f8")', '("phase", "f8", (2,))'),
        ("d.phase, _", "d.phase[3], _"),
        ("d.phase)", "d.phase[3])"),
    )
    with pytest.raises(ConformanceError, match="`fields` must declare"):
        check_disturbance("disturbance=surge", "noise=none", only=its_functions_stay_within_their_arrays)
    with pytest.raises(
        ConformanceError, match="the observations are the same with and without the disturbance"
    ):
        check_disturbance(
            "disturbance=surge", "disturbance.surge.force=0", only=it_changes_the_motion_or_the_readings
        )


@pytest.mark.slow
def test_a_disturbance_s_package_is_part_of_a_run_s_identity(site: Site) -> None:
    def frozen(*words: str) -> dict[str, Any]:
        plain = OmegaConf.to_container(compose("train", ["algo=pid", *words]), resolve=True)
        assert isinstance(plain, dict)
        return {str(key): value for key, value in plain.items()}

    calm = frozen("disturbance=none")
    surging(site)
    first = frozen("disturbance=surge")
    assert frozen("disturbance=none") == calm
    assert typed(OmegaConf.create(first)).disturbance.surge.period == 5.0
    assert releases(first) == {"swell": "1.0"}
    surging(site, version="2.0")
    assert run_id(first) != run_id(frozen("disturbance=surge"))
    with pytest.raises(ConfigError, match=r"comes with swell==1\.0, and swell==2\.0 is installed"):
        typed(OmegaConf.create(first))
    site.uninstall("swell")
    with pytest.raises(ConfigError, match=r"comes with swell==1\.0, and is not installed"):
        typed(OmegaConf.create(first))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("disturbance.surge.force=-2",), "disturbance.surge.force=-2: must be at least 0 and at most 10000"),
        (("disturbance.surge.forse=1",), "disturbance.surge.forse: unknown key; did you mean disturbance.surge.force?"),
        (("disturbance.surge.force=much",), "disturbance.surge.force: 'much' is not a number"),
        (("disturbance.surge=3",), "disturbance.surge"),
        (("disturbance=none", "+disturbance.surge.force=3"), "disturbance.surge.period: a value is missing"),
        (("disturbance=none", "+disturbance.surges.force=3"), "disturbance.surges.force: unknown key"),
        (("simulator=ros2",), "disturbance.surge: needs forces on vehicles, which simulator=ros2 does not have as configured"),
        (("disturbance=surg",), "did you mean 'surge'?"),
    ],
)  # fmt: skip
def test_what_is_typed_wrong_of_a_disturbance_is_one_line(
    site: Site, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], message: str
) -> None:
    surging(site)
    assert message in refused(capsys, "train", "algo=pid", "disturbance=surge", *words)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("surge:Surge", "surge:draw"), "surge:draw is not a subclass of"),
        (("math.sin(2.0", "math.sqrt(-1.0) + math.sin(2.0"), "push writes forces that are not finite, in environment 0"),
        (("d.phase, _, _, _ =", "d.phase = math.inf\n    _, _, _, _ ="), "draw writes phase that are not finite"),
        (("+ d.phase)", "+ d.phaze)"), "push fails: KeyError: 'phaze'"),
        (('(("phase", "f8"),)', '(("e phase", "f8"),)'), "e phase cannot be the name of a field"),
        (("    period: float", "    duration: float = 1.0\n    period: float"), "its key duration has the name of a parameter of every task"),
        (("    push = static", "    longest = 0.0\n    push = static"), "longest is 0.0; it must be a float of at least 0.0001 s"),
        (("        yield forces(key)", "        return []"), "has push, so the needs of its schema must yield auvbench.plugin.forces(key)"),
        (("return self.force > 0.0", "return self.forze"), "active fails: AttributeError"),
        (("    draw = static", "    def water_speed(settings, vehicle):\n        return 3\n    draw = static"), "water_speed returned 3.0; it must return 2 finite numbers"),
    ],
)  # fmt: skip
def test_what_a_disturbance_computes_wrong_is_named(
    site: Site, change: tuple[str, str], message: str
) -> None:
    surging(site, change)

    def step_once() -> None:
        environments = batch("disturbance=surge")
        environments.reset()
        environments.step(environments._action)

    with pytest.raises(AgentError) as raised:
        step_once()
    assert "disturbance.surge" in str(raised.value)
    assert message in str(raised.value)


@pytest.mark.slow
def test_a_simulator_that_fails_at_its_first_step_fails_the_run_of_a_controller(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    simulating(site, ("self.pose[:, 0] += ", "self.nothing += "))
    assert cli.main(["train", "algo=pid", "simulator=still"]) != 0
    assert "simulator=still of still-water==1.0: step fails: AttributeError" in capsys.readouterr().err
    (manifest,) = Path("outputs").rglob("manifest.json")
    assert RunDirectory(manifest.parent).manifest()["state"] == "failed"


@pytest.mark.slow
def test_a_launcher(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    files = {
        "inline.py": INLINE,
        "inline_conf/__init__.py": "",
        "inline_conf/launcher/inline.yaml": INLINE_YAML,
    }
    site.install(
        "in-line", files, points={"auvbench.launchers": {"inline": "inline:SPEC"}}, conf="inline_conf"
    )
    words = ["train", "-m", "algo=pid", "seed=0,1", "launcher=inline"]
    assert cli.main(words) == 0, capsys.readouterr().err
    assert Path("note.txt").read_text() == "hello"
    (kept,) = {path.parent.parent for path in Path("outputs").rglob("manifest.json")}
    runs = [RunDirectory(path.parent) for path in kept.rglob("manifest.json")]
    assert [run.manifest()["state"] for run in runs] == ["complete"] * 2
    assert "launcher.note=[1]: takes one value" in refused(capsys, *words, "launcher.note=[1]")
    site.uninstall("in-line")
    for run in runs:  # a run does not need what started it
        typed_config = run.check()
        assert typed_config["algo"]["agent"] == "pid"
    assert "no such option" in refused(capsys, *words)


@pytest.mark.slow
def test_a_tracker(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    site.install(
        "file-log", {"filelog.py": FILE_LOG}, points={"auvbench.trackers": {"filelog": "filelog:SPEC"}}
    )
    few = ["algo=ppo", "train.total_steps=64", "algo.n_envs=2", "algo.n_steps=16", "algo.batch_size=16"]
    assert cli.main(["train", *few, "train.log=filelog"]) == 0, capsys.readouterr().err
    lines = [json.loads(line) for line in Path("log.jsonl").read_text().splitlines()]
    assert [line[0] for line in lines][:2] == ["prepare", "start"]
    assert "write" in {line[0] for line in lines}
    assert lines[-1] == ["close", "None"]
    capsys.readouterr()
    assert "did you mean 'filelog'?" in refused(capsys, "train", *few, "train.log=filelogs")
    assert "did you mean 'filelog'?" in refused(capsys, "report", "outputs", "--log", "filelogs")


def test_a_tracker_without_its_functions(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    site.install(
        "file-log",
        {"filelog.py": FILE_LOG.replace("def table", "def tables")},
        points={"auvbench.trackers": {"filelog": "filelog:SPEC"}},
    )
    tracking.prepare.cache_clear()
    assert "train.log=filelog: filelog must define table" in refused(
        capsys, "train", "algo=pid", "train.log=filelog"
    )
    synthetic.write_experiment(site.folder / "study")
    words = ["report", str(site.folder / "study"), "--log", "filelog", "--no-figures"]
    assert "auvbench: --log filelog: filelog must define table" in refused(capsys, *words)


def test_a_command(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    site.install("greeting", {"hello.py": HELLO}, points={"auvbench.commands": {"hello": "hello:SPEC"}})
    assert cli.main(["hello"]) == 0
    assert cli.main(["hello", "there"]) == 3
    assert capsys.readouterr().out == "hello\nhello there\n"
    assert cli.main(["--help"]) == 0
    assert "hello       of greeting==1.0\n" in capsys.readouterr().out
    assert "hello" in candidates([""])
    assert "did you mean 'hello'?" in refused(capsys, "helo")
    assert cli.main(["hello", "fail"]) == 1
    assert "auvbench hello of greeting==1.0: fails: ValueError: no such word" in capsys.readouterr().err


def test_a_command_of_auvbench_s_name(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    site.install("thief", {"thief.py": HELLO}, points={"auvbench.commands": {"train": "thief:SPEC"}})
    assert cli.main(["train", "--help"]) == 0  # auvbench's own
    assert "hello" not in capsys.readouterr().out


def test_names_of_packages_are_listed_without_an_import(site: Site) -> None:
    broken = {"broken.py": "raise RuntimeError('imported')"}
    groups = {kind.group: {"theirs": "broken:SPEC"} for kind in (SIMULATORS, LAUNCHERS, TRACKERS, COMMANDS)}
    site.install("broken", broken, points=groups)
    for kind in (SIMULATORS, LAUNCHERS, TRACKERS, COMMANDS):
        assert kind.names() == (*kind.own, "theirs")
