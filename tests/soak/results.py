"""What may befall results, many times over: power cuts, kills of evaluate and report, flipped bits.

    python -m tests.soak.results --cuts 40 --kills 20 --flips 400 --seed 1 --folder /tmp/soak

Prints a line of JSON per kind of mishap. A *difference* is a number that is another one than without the mishap
and of which no word was said: there must be none.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import hashlib
import io
import json
import os
import random
import shutil
import signal
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tests.soak.bits import bits
from tests.soak.campaign import frozen, warm_up
from tests.soak.killing import kill_at_operation
from tests.soak.power import LOSSES, Disk

CASES = ("ppo-1", "sac-1")
TEST = ["protocol.episodes=30", "protocol.trajectories=2", "--workers", "1"]
REPORT = ["--format", "html,md,csv"]


@dataclasses.dataclass
class Tally:
    """What happened."""

    what: str
    mishaps: int = 0
    named: int = 0  # said in words: a problem of the report, a line of evaluate, a checkpoint not used
    harmless: int = 0  # no word, and every number as before
    differences: list[str] = dataclasses.field(default_factory=list)
    crashes: list[str] = dataclasses.field(default_factory=list)  # ended with a traceback


def quiet(*arguments: str) -> tuple[int, str]:
    """A command in this process: exit code and what it said."""
    from auvbench import cli

    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), warnings.catch_warnings():
        warnings.simplefilter("always")
        code = cli.main(list(arguments))
    return code, said.getvalue()


def killed(work: Callable[[], object], folder: Path, rng: random.Random, seconds: float, most: int) -> bool:
    """Does the work in a forked child that is killed at an operation below a folder or after a time; whether it was."""
    at_operation, amount = rng.random() < 0.6, rng.randint(1, most)
    child = os.fork()
    if child == 0:
        status = 1
        try:
            if at_operation:
                kill_at_operation(folder, amount)
            work()
            status = 0
        finally:
            os._exit(status)
    if not at_operation:
        time.sleep(rng.uniform(0.0, seconds))
        os.kill(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL


def cut_trainings(folder: Path, count: int, rng: random.Random) -> Tally:
    """Power cuts at any operation of a training; the same command then ends with the same bits."""
    from auvbench.runs import integrity
    from auvbench.training.execute import execute

    tally = Tally("power cuts in training")
    expected = {}
    for case in CASES:
        whole = frozen(folder / "whole", case, case, [])
        execute(whole)
        expected[case] = bits(whole.path)
    while tally.mishaps < count:
        case, place = rng.choice(CASES), folder / "cut"
        place.mkdir(parents=True)
        images: list[Path] = []
        with Disk(place) as disk:

            def strike(_operation: str, images: list[Path] = images, disk: Disk = disk) -> None:
                if rng.random() < 0.05:
                    images.append(disk.image(folder / f"image-{len(images)}", rng.choice(LOSSES), rng))

            disk.before = strike
            every = [f"train.checkpoint.steps={rng.choice([20, 50, 200])}"]
            execute(frozen(place, "cut", case, every))
            images.append(disk.image(folder / "ended", rng.choice(LOSSES), rng))
        for image in images:
            tally.mishaps += 1
            try:
                run = frozen(image, "cut", case, every)
                if run.manifest()["state"] == "complete":
                    tally.named += 1
                    if lost := integrity.lacking(run.path, run.manifest()):
                        tally.differences.append(f"complete, but {lost}")
                execute(run)
                found = bits(run.path)
                tally.differences += [key for key in found if found[key] != expected[case].get(key)]
            except Exception as error:
                tally.crashes.append(f"{image.name}: {type(error).__name__}: {error}")
            shutil.rmtree(image)
        shutil.rmtree(place)
    return tally


def cut_evaluations(made: Path, folder: Path, count: int, rng: random.Random) -> Tally:
    """Power cuts at any operation of evaluate; the same command then gives the same rows."""
    tally = Tally("power cuts in evaluate")
    expected = rows_of(made)
    while tally.mishaps < count:
        place = shutil.copytree(made, folder / "cut")
        images: list[Path] = []
        with Disk(place) as disk:

            def strike(_operation: str, images: list[Path] = images, disk: Disk = disk) -> None:
                if rng.random() < 0.15:
                    images.append(disk.image(folder / f"image-{len(images)}", rng.choice(LOSSES), rng))

            disk.before = strike
            quiet("evaluate", str(place), *TEST, "--force")
            disk.before = None
            images.append(disk.image(folder / "ended", rng.choice(LOSSES), rng))
        for image in images:
            tally.mishaps += 1
            without_locks(image)
            code, said = quiet("evaluate", str(image), *TEST)
            if code or rows_of(image) != expected:
                tally.differences.append(f"{image.name}: exit code {code}: {said[-300:]}")
            shutil.rmtree(image)
        shutil.rmtree(place)
    return tally


def kill_evaluations(made: Path, folder: Path, count: int, rng: random.Random) -> Tally:
    """SIGKILLs of evaluate; what stands there is whole, and the same command gives the same rows."""
    tally = Tally("kills of evaluate")
    expected = rows_of(made)
    place = shutil.copytree(made, folder / "killed")
    while tally.mishaps < count:
        tally.mishaps += killed(lambda: quiet("evaluate", str(place), *TEST, "--force"), place, rng, 3.0, 60)
        there = rows_of(place)
        tally.differences += [name for name in there if there[name] != expected[name]]
        if rng.random() < 0.3:
            code, said = quiet("evaluate", str(place), *TEST)
            if code or rows_of(place) != expected:
                tally.differences.append(f"exit code {code}: {said[-300:]}")
    return tally


def kill_reports(made: Path, folder: Path, count: int, rng: random.Random) -> Tally:
    """SIGKILLs of report; every file that stands there is whole, and the same command gives the same bytes."""
    tally = Tally("kills of report")
    place = shutil.copytree(made, folder / "killed")
    report = place / "report"
    quiet("report", str(place), *REPORT)
    expected = files_of(report)
    shutil.rmtree(report)
    while tally.mishaps < count:
        tally.mishaps += killed(lambda: quiet("report", str(place), *REPORT), report, rng, 8.0, 60)
        for name, digest in files_of(report).items():
            if digest != expected.get(name):
                tally.differences.append(name)
        if rng.random() < 0.2:
            quiet("report", str(place), *REPORT)
            tally.differences += [n for n, digest in expected.items() if files_of(report).get(n) != digest]
            shutil.rmtree(report)
    return tally


def flip_bits(made: Path, count: int, rng: random.Random) -> Tally:
    """Flipped bits in any file of a run: said in words wherever the file is read, or no number is another one."""
    tally = Tally("flipped bits")
    files = [p for p in sorted(made.rglob("*")) if p.is_file() and p.stat().st_size and "lock" not in p.parts]
    clean, _ = read(made)
    for _ in range(count):
        path = rng.choice(files)
        good = path.read_bytes()
        data = bytearray(good)
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        path.write_bytes(bytes(data))
        tally.mishaps += 1
        name = str(path.relative_to(made))
        try:
            found, said = read(made)
            if said:
                tally.named += 1
            elif found == clean:
                tally.harmless += 1
            else:
                changed = [key for key in clean if found.get(key) != clean[key]]
                tally.differences.append(f"{name}: {', '.join(changed)}")
        except Exception as error:
            tally.crashes.append(f"{name}: {type(error).__name__}: {error}")
        path.write_bytes(good)
    return tally


def read(made: Path) -> tuple[dict[str, str], list[str]]:
    """Digests of every number that report, evaluate, replay and resume read, and what they said of damage."""
    from auvbench.analysis.load import agents, load
    from auvbench.analysis.recorded import paths, training
    from auvbench.errors import AuvbenchError
    from auvbench.evaluation.evaluate import make_agent
    from auvbench.runs.directory import find_runs
    from auvbench.training.checkpoint.store import CheckpointStore

    said: list[str] = []
    found: dict[str, str] = {}

    @contextlib.contextmanager
    def told() -> Iterator[None]:
        from auvbench.analysis.damage import Damage

        try:
            yield
        except (AuvbenchError, Damage) as error:
            said.append(str(error))

    with told(), warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        runs, problems = load([made])
        said += [problem.message for problem in problems]
        grouped, more = agents(runs)
        said += [problem.message for problem in more]
        for agent in grouped:
            numbers = {name: values.tobytes() for name, values in sorted(agent.metrics.items())}
            found[agent.label] = _hash((agent.fingerprint, agent.outcome.tobytes(), numbers, dict(agent.key)))
        for record in runs:
            with told():
                found[f"{record.id} training"] = _hash(repr(training(record)))
            with told():
                for protocol in record.evaluations:
                    found[f"{record.id} paths"] = _hash(repr(list(paths(record, protocol, "nominal", 2))))
        for run in find_runs([made]):
            with told():
                import numpy as np

                run.check()
                agent_of = make_agent(run, 10.0)
                agent_of.reset(np.arange(8))
                seen = np.random.default_rng(0).normal(size=(8, 10)).astype(np.float32)
                found[f"{run.id} acts"] = _hash(agent_of.act(seen).tobytes())
            with told():
                checkpoint = CheckpointStore(run.path).peek()
                if checkpoint is not None:
                    found[f"{run.id} resumes"] = _hash(
                        (checkpoint.step, [_hash(data) for _, data in checkpoint.components.files()])
                    )
        said += [str(one.message) for one in warned if "checkpoint" in str(one.message)]
    return found, said


def _hash(value: Any) -> str:
    data = value if isinstance(value, bytes) else repr(value).encode()
    return hashlib.sha256(data).hexdigest()[:16]


def without_locks(image: Path) -> None:
    """Their holder, this process, lives; after a real cut they are of an earlier boot, and stale in five minutes."""
    for place in image.rglob("evaluations/.test"):
        shutil.rmtree(place)


def rows_of(folder: Path) -> dict[str, str]:
    """Digests of the rows of all evaluations, by run."""
    found = sorted(folder.rglob("evaluations/test/episodes.csv"))
    return {path.parts[-4]: _hash(path.read_bytes()) for path in found}


def files_of(report: Path) -> dict[str, str]:
    """Digests of the files of a report; a draft that a killed process left is none."""
    files = [p for p in sorted(report.rglob("*")) if p.is_file() and not p.name.startswith(".")]
    return {str(p.relative_to(report)): _hash(p.read_bytes()) for p in files}


def make(folder: Path) -> Path:
    """Two trained runs and a controller, tested: what everything is done to."""
    from auvbench.config.compose import compose
    from auvbench.runs.plan import prepare
    from auvbench.training.execute import execute

    for case in CASES:
        execute(frozen(folder, "made", case, []))
    execute(prepare(compose("train", ["algo=pid", f"output={folder}", "name=made"])))
    code, said = quiet("evaluate", str(folder), *TEST)
    if code:
        raise SystemExit(said)
    return folder / "made"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--cuts", type=int, default=40, help="power cuts in training, and a quarter in evaluate"
    )
    parser.add_argument("--kills", type=int, default=20, help="SIGKILLs of evaluate and of report, each")
    parser.add_argument("--flips", type=int, default=400, help="flipped bits")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, required=True)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore")
    warm_up(given.folder / "warm", CASES)
    made = make(given.folder / "results")

    def rng(what: str) -> random.Random:
        return random.Random(f"{given.seed} {what}")

    bad = False
    for work in (
        lambda: flip_bits(made, given.flips, rng("flips")),
        lambda: kill_evaluations(made, given.folder / "evaluate", given.kills, rng("evaluate")),
        lambda: kill_reports(made, given.folder / "report", given.kills, rng("report")),
        lambda: cut_evaluations(made, given.folder / "cuts", given.cuts // 4, rng("evaluate cuts")),
        lambda: cut_trainings(given.folder / "power", given.cuts, rng("cuts")),
    ):
        began = time.monotonic()
        tally = work()
        bad |= bool(tally.differences or tally.crashes)
        seconds = round(time.monotonic() - began, 1)
        print(json.dumps({**dataclasses.asdict(tally), "seconds": seconds}), flush=True)
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
