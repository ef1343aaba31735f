"""Kill `auvbench tune` at random moments and check what the studies end with.

    python -m tests.soak.tuning --kills 10 --folder /tmp/soak

Each attempt is the same command again. At the end of a study: no complete run was trained again, the journal only grew,
and every score follows from the verified evaluations of its runs. Print a line of JSON per study.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

from optuna.trial import TrialState

from auvbench.tuning import outcome, runs
from auvbench.tuning.folder import StudyFolder

STUDY = [
    "algo=ppo",
    "algo.n_envs=4",
    "algo.n_steps=choice(16,32)",
    "algo.batch_size=64",
    "algo.n_epochs=2",
    "algo.net_arch=[8]",
    "tune.trials=8",
    "tune.startup=3",
    "tune.rungs=[128,384]",
    "tune.reduction=2",
    "tune.fresh_seeds=[7]",
    "protocol.episodes=3",
    "launcher.workers=2",
]


@dataclasses.dataclass
class Tally:
    """What happened to one study."""

    study: str
    kills: int = 0
    in_search: int = 0  # kills between the first and the last operation of the journal
    complete_runs: int = 0
    problems: list[str] = dataclasses.field(default_factory=list)


def complete(study: StudyFolder) -> dict[Path, int]:
    """Return when the policy of each complete run was written."""
    return {
        manifest.parent: (manifest.parent / "model" / "policy.pt").stat().st_mtime_ns
        for folder in (study.runs, study.fresh)
        for manifest in folder.glob("*/manifest.json")
        if json.loads(manifest.read_text())["state"] == "complete"
    }


def attempt(folder: Path, name: str, kill_after: float | None) -> int:
    """Run the command, and kill it after so many seconds; return its exit status."""
    command = [sys.executable, "-m", "auvbench", "tune", *STUDY, f"output={folder}", f"name={name}"]
    with open(folder / f"{name}.txt", "ab") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
    try:
        return process.wait(kill_after)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def check(folder: Path, name: str, tally: Tally) -> None:
    """Add what is wrong with a study that has ended."""
    study = StudyFolder(folder / "tune" / name)
    found = outcome.read(study)
    states = [trial.state for trial in found.trials]
    if len(states) != 8 or not set(states) <= {TrialState.COMPLETE, TrialState.PRUNED}:
        tally.problems.append(f"trials: {[state.name for state in states]}")
    if not found.gains or not study.best.is_file():
        tally.problems.append("no comparison with fresh seeds, or no preset")
    for trial in found.trials:
        for rung, score in enumerate(found.results(trial)):
            made = runs.of_trial(found.plan, study, found.algo(trial), rung)
            if found.objective.of(made, found.plan.protocol.name) != score:
                tally.problems.append(f"trial {trial.number}: its score does not follow from its runs")
    tally.complete_runs = len(complete(study))


def campaign(folder: Path, name: str, kills: int, seconds: float, draws: random.Random) -> Tally:
    """Kill one study up to `kills` times within `seconds` of each start, then bring it to its end."""
    tally, study = Tally(name), StudyFolder(folder / "tune" / name)
    before: dict[Path, int] = {}
    while True:
        kept = study.journal.read_bytes() if study.journal.exists() else b""
        code = attempt(folder, name, draws.uniform(0.0, seconds) if tally.kills < kills else None)
        after = complete(study)
        if changed := [run.name for run, written in before.items() if after.get(run) != written]:
            tally.problems.append(f"trained again: {', '.join(changed)}")
        journal = study.journal.read_bytes() if study.journal.exists() else b""
        if not journal.startswith(kept[: kept.rfind(b"\n") + 1]):
            tally.problems.append("the journal lost an operation")
        before = after
        if code != -signal.SIGKILL:
            break
        tally.kills += 1
        tally.in_search += b"\n" in journal and not study.fresh.exists()
    if code != 0:
        tally.problems.append(f"exit status {code}: {(folder / f'{name}.txt').read_text()[-2000:]}")
    else:
        check(folder, name, tally)
    return tally


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20, help="of all studies")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--folder", type=Path, required=True)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    draws = random.Random(given.seed)
    began = time.monotonic()
    whole = campaign(given.folder, "whole", 0, 0.0, draws)
    seconds = 0.6 * (time.monotonic() - began)  # most attempts are killed
    tallies = [whole]
    while (left := given.kills - sum(tally.kills for tally in tallies)) > 0 and not tallies[-1].problems:
        tallies.append(campaign(given.folder, f"killed-{len(tallies)}", left, seconds, draws))
        print(json.dumps(dataclasses.asdict(tallies[-1])), flush=True)
    return int(any(tally.problems for tally in tallies))


if __name__ == "__main__":
    sys.exit(main())
