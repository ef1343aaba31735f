"""A controller on a vehicle: what it observes, its loop with all stops, and the record of its missions. No network.

`auvbench.ros2` and `auvbench.mavlink` are the networks.
"""
