"""Steer a vehicle with a controller: compute observations, run the loop with its safety stops, and record missions.

The network code is in `auvbench.integrations.ros2` and `auvbench.integrations.mavlink`.
"""
