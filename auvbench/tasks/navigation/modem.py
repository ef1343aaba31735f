"""Acoustic modem: ranges to the beacons of a team, which are vehicles that send their estimated position (docs/navigation.md).

The receiver measures the one-way travel time of a message; clocks are synchronous. The message contains the sender's estimated position at
the time of sending, and the covariance of this position. The message arrives after the transmission time and the travel time of the sound.
The range therefore belongs to a past position of the receiver, which is a state of the filter, as for a USBL.

A beacon's position error persists, so that a second range adds little information. The filter models this error as a first-order
autoregressive process with a correlation time. The filter multiplies the stated variance by the number of messages that together have as
much information as one independent message (Bayley and Hammersley, "The effective number of independent observations in an autocorrelated
time series", JRSS Supplement 8, 1946). Beacons do not use ranges, so that no information returns to its source and is counted twice.
"""

from __future__ import annotations

import math

from auvbench.config.ranges import SOUND
from auvbench.config.tasks.formation import MOST
from auvbench.dynamics.compiled import called
from auvbench.dynamics.layout import Vector
from auvbench.dynamics.vectors import dot, product, scale, subtract
from auvbench.tasks.navigation import ekf
from auvbench.tasks.navigation.ekf import Floats
from auvbench.tasks.navigation.state import MODEM, NEVER, normals
from auvbench.tasks.records import Record
from auvbench.tasks.rows import VEHICLE, between, misses, put, row, triple

SHORT = 0.1
"""Smallest range from which a direction is computed, m"""


@row
def begin(d: Record) -> None:
    """Forget all messages; the first turn begins at once."""
    d.turn = d.speaker = 0
    d.due[MODEM] = d.sent = d.measured_range = 0.0
    put(d.range_position, (0.0, 0.0, 0.0))
    put(d.beacon, (0.0, 0.0, 0.0))
    for j in range(MOST):
        d.beacon_sent[j] = -1.0


@row
def next_speaker(d: Record, p: Record) -> int:
    """Begin the next turn; return the index in the team of the vehicle that speaks."""
    d.speaker = d.turn % p.team
    d.turn += 1
    d.due[MODEM] = d.turn * p.turn_time
    d.arrives[MODEM] = NEVER
    return int(d.speaker)


@row
def hears(e: Record, d: Record, p: Record, stream: int) -> bool:
    """Return whether the vehicle uses the message of the present turn.

    The vehicle uses the message if a beacon sends it and the vehicle receives it and is not itself a beacon.
    """
    from_beacon = d.speaker < p.beacons and e.environment // VEHICLE >= p.beacons
    return bool(from_beacon and not misses(e, p, d.speaker, d.turn - 1, stream))


@called
def sense(e: Record, d: Record, p: Record, P: Floats, stream: int, beacon: Record, Q: Floats) -> None:
    """Measure the range to a beacon and store the beacon's message; range and message arrive later.

    `Q` is the covariance of the beacon's estimate.
    """
    error, _, _, _ = normals(e, d, stream, 22)
    way = between(triple(d.true_position), triple(beacon.true_position))
    d.measured_range = way + p.modem_noise * error
    ekf.propagate(beacon, p, Q)
    put(d.beacon, triple(beacon.position))
    for i in range(3):
        for j in range(3):
            d.stated[i, j] = Q[i, j]
    ekf.remember(d, p, P, p.modem_state)
    put(d.range_position, triple(d.position))
    d.sent = d.time
    d.arrives[MODEM] = (d.turn - 1) * p.turn_time + p.transmission + way / SOUND


@row
def sight(d: Record) -> tuple[Vector, float]:
    """Return the estimated direction from the beacon to the vehicle at the time of sending, and their distance in m."""
    way = subtract(triple(d.range_position), triple(d.beacon))
    r = max(math.sqrt(dot(way, way)), SHORT)
    return scale(1.0 / r, way), r


@row
def put_derivatives(p: Record, way: Vector, work: ekf.Work) -> None:
    """Write the derivatives of the range h = |x - beacon|, where x is the position at the time of sending."""
    work.slope[:] = 0.0
    ekf.put_row(work, p.modem_state, way)


@row
def along(S: Floats, k: int, way: Vector) -> float:
    """Return the variance (m2) of a position along a direction; the position's covariance begins at S[k, k]."""
    moved = ekf.three(S, k, k), ekf.three(S, k, k + 1), ekf.three(S, k, k + 2)
    return dot(way, product(moved, way))


@row
def bend(total: float, radial: float, r: float) -> float:
    """Return the root mean square (m) of a range's second-order term, which is c^2 / 2r for an error c perpendicular to the line of sight.

    Args:
        total: trace of the covariance of the relative position, m2.
        radial: variance of the relative position along the line of sight, m2.
        r: distance, m.
    """
    # The mean of c^4 is 3 times the squared variance.
    return math.sqrt(3.0) * max(total - radial, 0.0) / (2.0 * r)


@row
def independent(d: Record, p: Record) -> float:
    """Return how many messages of a beacon have as much information about the beacon's position as one independent message."""
    last = d.beacon_sent[d.speaker]
    kept = math.exp((last - d.sent) / p.modem_memory) if last >= 0.0 else 0.0
    return (1.0 + kept) / (1.0 - kept)


@called
def correct(d: Record, p: Record, P: Floats, work: ekf.Work) -> None:
    """Correct the estimate by the range of a message that has arrived."""
    ekf.propagate(d, p, P)
    k, S = p.modem_state, d.stated
    way, r = sight(d)
    own, others = along(P, k, way), along(S, 0, way)
    total = P[k, k] + P[k + 1, k + 1] + P[k + 2, k + 2] + S[0, 0] + S[1, 1] + S[2, 2]
    curved = bend(total, own + others, r)
    sd = math.sqrt(p.modem_noise**2 + curved**2 + independent(d, p) * others)
    put_derivatives(p, way, work)
    work.change[:] = 0.0
    if ekf.update(d, p, P, work, MODEM, 0, d.measured_range - r, sd, k, k + 3):
        ekf.inject(d, p, P, work)
    d.beacon_sent[d.speaker] = d.stamp[MODEM] = d.sent
