"""Disturbances of N episodes: currents, waves, actuator faults, delays, sensor errors, drawn vehicles.

`parameters.Disturbances` is what the batch of environments calls; `kernels` draws and advances, compiled.
docs/disturbances.md defines each of them.
"""

from auvbench.tasks.disturbances.parameters import Disturbances, make

__all__ = ["Disturbances", "make"]
