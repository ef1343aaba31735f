"""Timing on a noisy machine: the best of several repetitions, so that ratios within one run mean something."""

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
    """Seconds per call: the fastest of several repetitions, each as many calls as fill `seconds`."""
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
    """Turns per second of processor time of the plain loop in `.ci/run`: rates of two machines compare once divided by it."""

    def loop() -> None:
        x = 0.0
        for i in range(turns):
            x += i * 0.5

    return turns / best(loop, repetitions=3, clock=time.thread_time)


def command(*arguments: str, repetitions: int = 5, fresh: bool = False) -> float:
    """Seconds of a whole `auvbench` command, interpreter and imports included; the fastest of several.

    With `fresh`, each in an empty folder: what a command has written the next one would find done.
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
