"""Compute bounds of the shortest time to the goal in each scenario of a protocol; docs/bound.md describes the
method.

The upper bound is the time of a trajectory that reaches the goal in the simulator; optimal control found it.
The lower bound is a time that no trajectory can beat; it follows from the energy that the thrusters can supply.
"""
