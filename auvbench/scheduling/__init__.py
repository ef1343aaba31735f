"""Carrying out many runs: on this machine, on a SLURM cluster, on Ray.

A backend starts a frozen run directory somewhere and says how it ended; one loop drives any of them (`loop`). `grid.sweep`
is the whole of it: look at what is there, say so, run the rest, sum up.
"""
