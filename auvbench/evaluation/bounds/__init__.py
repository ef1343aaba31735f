"""The limit: how soon the vehicle could be inside the goal at all, for each scenario of a protocol.

Two numbers bracket the shortest time. Above it, a trajectory that was found by optimal control and then simulated: it
arrives. Below it, a bound that no trajectory can break, from the energy that the thrusters can give. docs/bound.md.
"""
