"""Disturbances of N episodes: one file each, and `composed`, which calls the active ones.

docs/disturbances.md defines each of them.
"""

from auvbench.tasks.disturbances.composed import Disturbances, check, make, of

__all__ = ["Disturbances", "check", "make", "of"]
