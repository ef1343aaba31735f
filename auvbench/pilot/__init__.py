"""Steer a vehicle with a controller: observations, the loop with all its stops, and the record of missions.

This package has no network code; `auvbench.ros2` and `auvbench.mavlink` have.
"""
