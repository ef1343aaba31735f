"""Measure times on a busy machine: the best of several repetitions, so that ratios within one run are meaningful."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path


def best(
    function: Callable[[], object],
    *,
    seconds: float = 0.3,
    repetitions: int = 7,
    clock: Callable[[], float] = time.perf_counter,
) -> float:
    """Return the seconds per call: the fastest of several repetitions, each with enough calls to last `seconds`."""
    function()
    begun = clock()
    function()
    once = max(clock() - begun, 1e-7)
    calls = max(1, int(seconds / repetitions / once))
    fastest = float("inf")
    for _ in range(repetitions):
        begun = clock()
        for _ in range(calls):
            function()
        fastest = min(fastest, (clock() - begun) / calls)
    return fastest


def loop_rate(turns: int = 2_000_000) -> float:
    """Return the turns of the plain loop of `.ci/run` per second of processor time. Divided by it, rates of two machines compare."""

    def loop() -> None:
        x = 0.0
        for i in range(turns):
            x += i * 0.5

    return turns / best(loop, repetitions=3, clock=time.thread_time)


def command(*arguments: str, repetitions: int = 5, fresh: bool = False) -> float:
    """Return the seconds of a whole `auvbench` command, with the start of Python and all imports: the fastest of several.

    With `fresh`, each runs in an empty folder, since a command does not repeat finished work.
    """
    script = str(Path(sys.executable).with_name("auvbench"))
    fastest = float("inf")
    for _ in range(repetitions):
        with tempfile.TemporaryDirectory() as folder:
            begun = time.perf_counter()
            where = folder if fresh else None
            subprocess.run([script, *arguments], stdout=subprocess.DEVNULL, check=True, cwd=where)
            fastest = min(fastest, time.perf_counter() - begun)
    return fastest
