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


def measure_names() -> tuple[str, ...]:
    """Return the names of everything that agents can be compared by; `analysis.measures` computes them."""
    means = [name for name in RECORD_COLUMNS if name not in ("episode", "environment", "outcome")]
    return (
        *(f"{outcome}_rate" for outcome in OUTCOMES),
        *(f"par{penalty}_{of}" for of in ("steps", "time_s") for penalty in (1, 2)),
        *(f"mean_{name}" for name in (*means, "time_to_goal_s") if name not in SCENARIO_COLUMNS),
    )


Record = dict[str, float | int | str]
