"""Compute bounds of the shortest time to the goal in each scenario of a protocol; docs/bound.md describes the
method.

The upper bound is the duration of a trajectory, found by optimal control, that reaches the goal in the simulator.
The lower bound is a time that no trajectory can beat. It follows from the energy that the thrusters can supply.
"""
