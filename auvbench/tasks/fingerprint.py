"""List the columns and blocks that fingerprints cover (`evaluation.reference`), for all of auvbench's tasks except waypoint.

The lists must not grow, so that a new metric or block does not change the fingerprints of published results.
"""

from __future__ import annotations

COLUMNS = (
    "episode",
    "environment",
    "outcome",
    "steps",
    "duration_s",
    "return",
    "initial_distance_m",
    "final_distance_m",
    "command_norm_mean_N",
    "command_norm_sum_N",
    "energy_J",
    "path_length_m",
    "smoothness_per_s",
    "depth_margin_m",
    "start_yaw_rad",
    "start_x_m",
    "start_y_m",
    "start_z_m",
    "goal_x_m",
    "goal_y_m",
    "goal_z_m",
)
"""Columns of a record that the fingerprints of all these tasks cover; each task adds its own columns"""

BLOCKS = (
    "yaw_error",
    "position_error",
    "velocity_error",
    "velocity",
    "angular_velocity",
    "gravity",
    "depth_margin",
    "previous_action",
)
