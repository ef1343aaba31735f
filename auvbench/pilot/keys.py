"""The stop key: Enter on the terminal."""

from __future__ import annotations

import os
import select
import sys


def enter() -> bool:
    """Return whether Enter was pressed since the last call; without a terminal in the foreground it never was."""
    try:
        number = sys.stdin.fileno()
        # A process in the background that reads from its terminal is halted.
        if not os.isatty(number) or os.tcgetpgrp(number) != os.getpgrp():
            return False
        return bool(select.select([number], [], [], 0.0)[0]) and b"\n" in os.read(number, 1024)
    except (OSError, ValueError, AttributeError):  # a closed standard input
        return False
