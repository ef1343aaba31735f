"""Carry out many runs: on this machine, on a SLURM cluster, or on Ray.

A backend starts a frozen run directory somewhere and reports how it ended. One loop drives every backend
(`loop`). `grid.sweep` is the entry point: it checks the existing runs, prints the plan, carries out the runs that are
not complete, and prints a summary.
"""
