"""Disturbances of N episodes: each has its own file, and `composed` calls the active disturbances.

docs/disturbances.md defines each disturbance.
"""

from auvbench.tasks.disturbances.composed import Disturbances, check, make, of

__all__ = ["Disturbances", "check", "make", "of"]
