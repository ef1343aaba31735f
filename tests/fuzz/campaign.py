"""`python -m tests.fuzz.campaign --minutes 60`: every target in turn with new random numbers, and what it found.

A failure is written down with the smallest input that hypothesis found and the campaign goes on; the exit code says
whether there was one.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings

from tests.fuzz import targets
from tests.fuzz.harness import nothing_long

ROUND = 15  # examples of a target before the next has its turn


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--only", default="")
    given_ = parser.parse_args()
    names = [name for name in ("command lines", *targets.FILES) if given_.only in name]
    counts = dict.fromkeys(names, 0)
    failures: dict[str, str] = {}
    until = time.monotonic() + 60 * given_.minutes
    number = 0
    with tempfile.TemporaryDirectory(prefix="auvbench-fuzz-") as folder, nothing_long(Path(folder)):
        targets.keys()
        while time.monotonic() < until:
            name = names[number % len(names)]
            number += 1
            try:
                _round(name, Path(folder), given_.seed + number, counts, until)
            except KeyboardInterrupt:
                break
            except BaseException as error:
                lines = traceback.format_exception(error)
                key = f"{name}: {_place(error)}"
                if key not in failures:
                    failures[key] = "".join(lines)
                    print(f"--- {key} (seed {given_.seed + number})\n{failures[key]}", flush=True)
            if number % len(names) == 0:
                done = ", ".join(f"{count} {what}" for what, count in counts.items())
                print(f"{done}; {len(failures)} distinct failures", flush=True)
    done = ", ".join(f"{count} {what}" for what, count in counts.items())
    print(f"\n{sum(counts.values())} examples: {done}\n{len(failures)} distinct failures")
    for key in failures:
        print(f"  {key}")
    return 1 if failures else 0


def _place(error: BaseException) -> str:
    """The last line of the report: what tells one defect from another."""
    return str(error).strip().splitlines()[-1][:200] if str(error).strip() else type(error).__name__


def _round(name: str, folder: Path, number: int, counts: dict[str, int], until: float) -> None:
    # The generator is seeded; shrinking is left out for speed where an input is a file.
    options = settings(
        max_examples=ROUND,
        deadline=None,
        database=None,
        phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
    )
    if name == "command lines":

        @seed(number)
        @options
        @given(targets.overrides(), targets.wholes())
        def lines(words: list[str], choice: int) -> None:
            if time.monotonic() < until:
                counts[name] += 1
                targets.command_line(folder, words, choice)

        lines()
        return

    @seed(number)
    @options
    @given(targets.wholes(), targets.values(), targets.wholes(), targets.wholes())
    def files(where: int, value: Any, how: int, salt: int) -> None:
        if time.monotonic() < until:
            counts[name] += 1
            targets.FILES[name](folder, where, value, how, salt)

    files()


if __name__ == "__main__":
    sys.exit(main())
