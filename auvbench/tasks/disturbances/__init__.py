"""Disturbances of N episodes: currents, actuator faults, delays, sensor errors, drawn vehicles.

`model.Disturbances` is what the batch of environments calls; `kernels` draws and advances, compiled;
`segments` splits an agent step where a delayed command begins to act or a delayed measurement is taken.
docs/disturbances.md defines each of them.
"""

from auvbench.tasks.disturbances.parameters import Disturbances, make

__all__ = ["Disturbances", "make"]
