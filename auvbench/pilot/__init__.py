"""Steer a vehicle with a controller: observations, the loop with all its stops, and the record of missions.

This package has no network code; `auvbench.integrations.ros2` and `auvbench.integrations.mavlink` have.
"""
