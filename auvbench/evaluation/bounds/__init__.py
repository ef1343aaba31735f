"""Bounds of the shortest time to the goal, for each scenario of a protocol. docs/bound.md has the method.

The upper bound is a trajectory found by optimal control that arrives in the simulator. The lower bound is a time that no
trajectory can beat, from the energy that the thrusters can give.
"""
