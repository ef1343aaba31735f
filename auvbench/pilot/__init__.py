"""Steer a vehicle with a controller: observations, the loop with all its stops, and the record of missions.

The network code is in `auvbench.integrations.ros2` and `auvbench.integrations.mavlink`.
"""
