"""Imported by the fork server alone: tie it to its command, then import what workers need (see `pool`)."""

from __future__ import annotations

import contextlib
import importlib
import os

from auvbench.runs import processes

COMMAND, MODULES = "AUVBENCH_COMMAND_PID", "AUVBENCH_PRELOAD"
"""environment variables of the server: the pid of its command, and module names with commas between them"""

PID = os.getpid()
"""of the server, also in the workers that it forks"""

if COMMAND in os.environ:
    processes.die_with_parent(int(os.environ.pop(COMMAND)))
    for _module in os.environ.pop(MODULES).split(","):
        with contextlib.suppress(Exception):  # the worker that needs it reports the error
            importlib.import_module(_module)
