"""What is recorded of an episode; apart from the task, so that who only reads records does not load the compiler."""

from __future__ import annotations

OUTCOMES = ("success", "collision", "timeout")
"""How an episode ends, in the order of the codes 0, 1, 2 (`SUCCESS`, `COLLISION`, `TIMEOUT` in tasks/kernels.py)."""

RECORD_COLUMNS = (
    "episode",
    "environment",
    "outcome",
    "steps",
    "duration_s",
    "return",
    "initial_distance_m",
    "final_distance_m",
    "deviation_mean_m",
    "deviation_std_m",
    "command_norm_mean_N",
    "command_norm_sum_N",
    "energy_J",
    "path_length_m",
    "path_efficiency",
    "smoothness_per_s",
    "depth_margin_m",
    "waypoint_x_m",
    "waypoint_y_m",
    "waypoint_z_m",
    "start_yaw_rad",
)
"""A record: one row per episode, the same in training and in tests. Definitions in docs/protocol.md."""

SCENARIO_COLUMNS = (
    "initial_distance_m",
    "waypoint_x_m",
    "waypoint_y_m",
    "waypoint_z_m",
    "start_yaw_rad",
)
"""Columns that say something of the scenario alone, the same for every agent that meets it."""

Record = dict[str, float | int | str]
