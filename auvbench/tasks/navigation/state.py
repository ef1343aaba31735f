"""Define the fields that store the sensors and the estimate of an episode, and the parameters of sensors and estimator."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from statistics import NormalDist
from typing import Any

from scipy.special import chdtri

from auvbench.config import schema
from auvbench.config.navigation import Gnss, Model, Usbl
from auvbench.config.tasks.formation import MOST
from auvbench.dynamics.compiled import called
from auvbench.dynamics.layout import Quaternion
from auvbench.dynamics.random import NAVIGATION, normal4, uniform4
from auvbench.tasks.records import Record
from auvbench.tasks.rows import row

STATES = 15
"""Number of states of the filter: errors of position, velocity, attitude (world axes), accelerometer bias and gyro bias (body axes)"""
MODEL_STATES = 17
"""Number of states of the filter with model aiding: also errors of a horizontal current (world axes)"""
VELOCITY, ATTITUDE, ACCELERATION_BIAS, RATE_BIAS, CURRENT = 3, 6, 9, 12, 15
"""First index of each group of states; position is at 0. Optional states follow: the DVL's scale at `p.scale_state`, the compass's constant
error at `p.bias_state`, the position at a USBL's last ping at `p.ping_state`, and the position at a beacon's last message at
`p.modem_state`."""
DVL, DEPTH, HEADING, MODEL, USBL, GNSS, MODEM, WATER = 0, 1, 2, 3, 4, 5, 6, 7
"""Index of a sensor in `due`, `arrives`, `stamp`, `nis` and so on. WATER is the DVL's water track: its pings are due and arrive
with the DVL's pings."""
SOON = 1e-6
"""Tolerance of times, s: a measurement that is due within this time is due now"""
NEVER = 1e300
"""Arrival time of a sensor that has no reading under way, s"""

_V, _Q, _S = (3,), (4,), (8,)
FIELDS: tuple[tuple[Any, ...], ...] = (
    ("samples", "i8"),  # number of IMU samples in the episode
    ("time", "f8"),  # s, in the episode
    # The truth at the last sample.
    ("true_position", "f8", _V),
    ("true_velocity", "f8", _V),  # m/s, world axes
    ("true_attitude", "f8", _Q),
    ("true_rates", "f8", _V),  # rad/s, body axes
    # IMU
    ("turn_on_acceleration", "f8", _V),  # m/s2
    ("turn_on_rates", "f8", _V),  # rad/s
    ("walk_acceleration", "f8", _V),  # m/s2, the part of the bias that changes
    ("walk_rates", "f8", _V),  # rad/s
    ("specific_force", "f8", _V),  # m/s2, measured: mean over the last interval
    ("rates", "f8", _V),  # rad/s, measured
    # DVL
    ("merit", "f8"),  # m/s, figure of merit (`dvl.beam_sd`)
    ("dvl_scale", "f8"),
    ("mounting", "f8", _V),  # rad
    ("burst", "i8"),  # 1: in a burst without lock
    ("dvl_period", "f8"),  # s, from the last ping to the next one
    ("on_water", "i8"),  # 1: the last ping is relative to the water
    ("beams", "i8"),  # number of valid beams of the last ping
    ("valid", "i8", (4,)),  # 1: the beam is valid
    ("beam_velocity", "f8", _Q),  # m/s, measured
    ("dvl_velocity", "f8", _V),  # m/s, measured, body axes at the DVL
    ("predicted_velocity", "f8", _V),  # m/s, velocity that the estimate predicts for the last ping
    ("altitude", "f8"),  # m, measured altitude; 0: no altitude measured
    # Depth and heading
    ("depth_scale", "f8"),
    ("depth_offset", "f8"),  # m
    ("wave_variance", "f8"),  # m2, variance of the measured height due to the waves' pressure
    ("wave_readings", "f8"),  # number of readings that share the error of the waves
    ("height", "f8"),  # m, measured z
    ("predicted_height", "f8"),
    ("heading_bias", "f8"),  # rad
    ("hard_iron", "f8"),  # rad, amplitude of one cycle per turn
    ("hard_iron_phase", "f8"),  # rad
    ("soft_iron", "f8"),  # rad, amplitude of two cycles per turn
    ("soft_iron_phase", "f8"),
    ("thruster_iron", "f8"),  # rad, amplitude of one cycle per turn, due to the thrusters' electric current
    ("thruster_phase", "f8"),
    ("heading", "f8"),  # rad, measured
    ("predicted_heading", "f8"),
    # Positions
    ("alignment", "f8"),  # rad, misalignment of the USBL's head about the vertical
    ("usbl_burst", "i8"),  # 1: in a burst without positions
    ("ping_time", "f8"),  # s, time of the USBL's last answered ping
    ("fix", "f8", _V),  # m, measured by the USBL
    ("ping_position", "f8", _V),  # m, present estimate of the position at that ping
    ("gnss_offset", "f8", (2,)),  # m
    ("gnss_fix", "f8", (2,)),  # m, measured
    # Ranges of messages
    ("turn", "i8"),  # number of turns that have begun
    ("speaker", "i8"),  # index in the team of the vehicle that speaks in the last turn
    ("sent", "f8"),  # s, sending time of the last message that is heard from a beacon
    ("measured_range", "f8"),  # m
    ("range_position", "f8", _V),  # m, present estimate of the receiver's position at the sending time
    ("beacon", "f8", _V),  # m, position of the beacon at the sending time, as the beacon itself estimated it
    ("stated", "f8", (3, 3)),  # m2, covariance of the beacon's estimate
    ("beacon_sent", "f8", (MOST,)),  # s, sending time of the last range to each beacon; -1: no range yet
    # Values of each sensor
    ("due", "f8", _S),  # s, time of the next measurement
    ("arrives", "f8", _S),  # s, arrival time of the reading under way
    ("stamp", "f8", _S),  # s, measuring time of the last valid reading that arrived
    ("rejected", "i8", (32,)),  # readings in a row that failed the gate; four counters for each sensor
    ("nis", "f8", _S),  # sum of normalised innovations squared
    ("innovations", "f8", _S),  # number of innovations in `nis`
    # Estimate
    ("position", "f8", _V),
    ("velocity", "f8", _V),  # m/s, world axes
    ("attitude", "f8", _Q),
    ("acceleration_bias", "f8", _V),
    ("rate_bias", "f8", _V),
    ("current", "f8", (2,)),  # m/s, world axes
    ("scale", "f8"),  # error of the DVL's scale
    ("bias", "f8"),  # rad, constant error of the compass
    ("water_velocity", "f8", _V),  # m/s, body axes: the last velocity of dead reckoning
    ("elapsed", "f8"),  # s since the covariance was propagated
    ("force_sum", "f8", _V),  # m/s, integral of the specific force in world axes over `elapsed`
    ("rotation_sum", "f8", (9,)),  # s, integral of the rotation matrix over `elapsed`
    ("diverged", "i8"),  # 1: the estimate has diverged and no longer moves
    # Metrics
    ("error", "f8"),  # m, position error at the last step
    ("error_squared_sum", "f8"),  # m2
    ("counted", "f8"),
    ("nees", "f8"),  # sum over steps of the position's normalised estimation error squared
    ("unlocked", "f8"),  # s without bottom lock
)
"""Fields of `d`, the record of an episode's sensors and estimate"""

MODES = 5
"""Number of range modes in the parameters of a vehicle without a DVL; another number would need newly compiled code"""
GATED_FIXES = 5
"""Number of USBL positions that the gate may reject in a row; USBL positions come about once a second"""
GATED = 20
"""Number of a sensor's readings that the gate may reject in a row. After that, the filter accepts readings until one passes the gate, so
that the filter can recover"""


def parameters(config: schema.TrainConfig, gravity: float) -> dict[str, Any]:
    """Return the parameters `p` by name; parameters of sensors that the vehicle does not have are 0."""
    sensors, navigation = config.sensors, config.navigation
    imu, dvl, depth, heading = sensors.imu, sensors.dvl, sensors.depth, sensors.heading
    assert imu
    assert depth
    assert heading
    biased = getattr(navigation, "heading_bias", False)
    slow = math.sqrt(
        (0.0 if biased else heading.bias**2) + 0.5 * heading.hard_iron**2 + 0.5 * heading.soft_iron**2
    )
    gate = getattr(navigation, "gate", 1.0)
    model = getattr(navigation, "model", None)
    pings = MODES if dvl is None else len(dvl.rates)
    usbl, gnss = sensors.usbl, sensors.gnss
    current_end = STATES if model is None else MODEL_STATES
    scaled = getattr(navigation, "dvl_scale", False)
    modem_state = current_end + scaled + biased + (0 if usbl is None else 3)
    modem, task = sensors.modem, config.task
    states = modem_state + (0 if modem is None else 3)
    return {
        "states": states,
        "current_end": current_end,  # index after the states of the current
        "scale_state": current_end if scaled else 0,  # 0: the scale is not a state
        "bias_state": current_end + scaled if biased else 0,
        "ping_state": 0 if usbl is None else modem_state - 3,  # 0: the vehicle has no USBL
        "modem_state": 0 if modem is None else modem_state,
        "beacons": 0 if modem is None else modem.beacons,
        "modem_noise": 0.0 if modem is None else modem.noise,
        "modem_memory": 1.0 if modem is None else modem.memory,
        "team": task.team,
        **{key: 0.0 if modem is None else float(getattr(task, key)) for key in _MESSAGES},
        "is_filter": int(navigation.is_filter),
        "gravity": gravity,
        "start_position": navigation.start.position,
        "start_velocity": navigation.start.velocity,
        "start_tilt": navigation.start.tilt,
        # quantiles of chi-square with 1 and 3 degrees of freedom
        "gate": NormalDist().inv_cdf(0.5 + 0.5 * gate) ** 2 if gate < 1.0 else math.inf,
        "gate_of_three": float(chdtri(3, 1.0 - gate)) if gate < 1.0 else math.inf,
        "inflation": getattr(navigation, "inflation", 1.0),
        "settling": getattr(navigation, "settling", 1.0),
        "imu_rate": imu.rate,
        "has_model": int(model is not None),
        **{f"model_{key.name}": 0.0 if model is None else getattr(model, key.name) for key in fields(Model)},
        **_numbers("gyro", imu.gyro),
        **_numbers("accelerometer", imu.accelerometer),
        **_numbers("depth", depth),
        **_numbers("heading", heading),
        "heading_slow": slow,
        "has_dvl": int(dvl is not None),
        "dvl_lever": [0.0] * 3 if dvl is None else dvl.lever,
        "dvl_altitudes": [0.0] * pings if dvl is None else dvl.altitudes,
        "dvl_periods": [1.0] * pings if dvl is None else [1.0 / rate for rate in dvl.rates],
        "dvl_sine": 0.0 if dvl is None else math.sin(dvl.tilt),  # sine of a beam's tilt
        "dvl_cosine": 1.0 if dvl is None else math.cos(dvl.tilt),
        "dvl_flattest": 0.0 if dvl is None else math.cos(dvl.incidence),
        **{f"dvl_{name}": 0.0 if dvl is None else float(getattr(dvl, name)) for name in _DVL},
        "has_usbl": int(usbl is not None),
        "usbl_vehicles": 0 if usbl is None else usbl.vehicles,
        "usbl_position": [0.0] * 3 if usbl is None else usbl.position,
        **{
            f"usbl_{key.name}": 0.0 if usbl is None else float(getattr(usbl, key.name))
            for key in fields(Usbl)
            if key.name not in ("position", "vehicles")
        },
        "has_gnss": int(gnss is not None),
        **{
            f"gnss_{key.name}": 0.0 if gnss is None else float(getattr(gnss, key.name))
            for key in fields(Gnss)
        },
    }


_DVL = (
    *("low", "high", "fastest", "merit_low", "merit_high", "scale", "mounting"),
    *("lost", "burst", "delay"),
    *("water_track", "water_rate", "water_noise", "water_near", "water_far"),
)

_MESSAGES = ("turn_time", "transmission", "message_loss")


def _numbers(prefix: str, sensor: Any) -> Mapping[str, float]:
    return {f"{prefix}_{name}": float(value) for name, value in vars(sensor).items()}


@called
def normals(e: Record, d: Record, stream: int, block: int) -> Quaternion:
    """Return four standard normal numbers of the present sample; each `block` has its own numbers."""
    return normal4(e.seed, NAVIGATION | stream, block, d.samples, e.episode, e.environment)


@called
def uniforms(e: Record, d: Record, stream: int, block: int) -> Quaternion:
    """Return four uniform numbers in (0, 1) of the present sample; each `block` has its own numbers."""
    return uniform4(e.seed, NAVIGATION | stream, block, d.samples, e.episode, e.environment)


@row
def next_of_burst(burst: int, share: float, pause: float, u: float) -> int:
    """Return 1 if the next ping is in a burst without readings, otherwise 0. Bursts are a two-state Markov chain.

    Args:
        burst: whether the present ping is in a burst.
        share: share of the time in bursts; 1: always.
        pause: time between two pings, divided by the mean duration of a burst.
        u: uniform draw.
    """
    if share >= 1.0:
        return 1
    back = min(1.0, pause)
    away = back * share / (1.0 - share)
    return int(u >= back) if burst > 0 else int(u < away)


@row
def is_due(d: Record, sensor: int) -> bool:
    """Return whether a sensor measures now."""
    return bool(d.time + SOON >= d.due[sensor])


@row
def expect(d: Record, sensor: int, period: float, delay: float) -> None:
    """Write when a sensor that measures now will measure again, and when its present reading arrives."""
    d.due[sensor] += period
    if d.due[sensor] < d.time:  # the next measurement is late already
        d.due[sensor] = d.time + period
    d.arrives[sensor] = d.time + delay


@row
def has_arrived(d: Record, sensor: int) -> bool:
    """Return whether a reading arrives now; if so, mark it as no longer under way."""
    if d.time + SOON < d.arrives[sensor]:
        return False
    d.arrives[sensor] = NEVER
    return True
