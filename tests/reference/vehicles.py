"""The vehicles' numbers, transcribed a second time from their sources, apart from the sheets in `conf/vehicle`.

Each vehicle stands in the frame of its source: NED/FRD where the source is a paper in Fossen's notation, ENU/FLU
where it is a ROS or Gazebo model.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .fossen import ENU, NED, Array, Body


def _vector(*values: float) -> Array:
    return np.array(values, dtype=float)


WU_ADDED = np.diag([5.5, 12.7, 14.57, 0.12, 0.12, 0.12])
WU_LINEAR = _vector(4.03, 6.22, 5.18, 0.07, 0.07, 0.07)
WU_QUADRATIC = _vector(18.18, 21.66, 36.99, 1.55, 1.55, 1.55)

BLUEROV2 = Body(
    name="bluerov2",
    m=15.22,
    r_g=_vector(0, 0, -0.1142),
    I_g=np.array([[5.2539, 0.0144, 0.3341], [0.0144, 7.9420, 0.026], [0.3341, 0.026, 6.9123]]),
    M_A=WU_ADDED,
    D_l=_vector(25.15, 7.364, 17.955, 10.888, 20.761, 3.744),
    D_q=_vector(33.8, 54.26875, 73.37135, 40, 40, 40),
    W=15.22 * 9.8,
    B=1000 * 9.8 * 0.0156812,
    r_b=_vector(0, 0, -0.029045),
    down=ENU,
)
"""Centrale Nantes, the vehicle of the thesis."""

WU2018 = Body(
    name="bluerov2_wu2018",
    m=11.5,
    r_g=_vector(0, 0, 0.02),
    I_g=np.diag([0.21, 0.245, 0.245]),
    M_A=WU_ADDED,
    D_l=WU_LINEAR,
    D_q=WU_QUADRATIC,
    W=11.5 * 9.81,
    B=114.8,
    r_b=_vector(0, 0, 0),
    down=NED,
)
"""Wu 2018 as gym_dockauv holds it, the source of the wu2018 trajectories."""

VON_BENZON = Body(
    name="bluerov2_heavy",
    m=13.5,
    r_g=_vector(0, 0, 0),
    I_g=np.diag([0.26, 0.23, 0.37]),
    M_A=np.diag([6.36, 7.12, 18.68, 0.189, 0.135, 0.222]),
    D_l=_vector(13.7, 0, 33.0, 0, 0.8, 0),
    D_q=_vector(141, 217, 190, 1.19, 0.47, 1.5),
    W=13.5 * 9.82,
    B=1000 * 9.82 * 0.0134,
    r_b=_vector(0, 0, -0.01),
    down=NED,
)
"""von Benzon et al. 2022 (BlueROV2 Heavy)."""

_REXROV_ADDED = np.array(
    [
        [779.79, -6.8773, -103.32, 8.5426, -165.54, -7.8033],
        [-6.8773, 1222, 51.29, 409.44, -5.8488, 62.726],
        [-103.32, 51.29, 3659.9, 6.1112, -386.42, 10.774],
        [8.5426, 409.44, 6.1112, 534.9, -10.027, 21.019],
        [-165.54, -5.8488, -386.42, -10.027, 842.69, -1.1162],
        [-7.8033, 62.726, 10.775, 21.019, -1.1162, 224.32],
    ]
)

REXROV = Body(
    name="rexrov",
    m=1862.87,
    r_g=_vector(0, 0, 0),
    I_g=np.array([[525.39, 1.44, 33.41], [1.44, 794.20, 2.60], [33.41, 2.60, 691.23]]),
    M_A=(_REXROV_ADDED + _REXROV_ADDED.T) / 2,
    D_l=_vector(74.82, 69.48, 728.4, 268.8, 309.77, 105),
    D_q=_vector(748.22, 992.53, 1821.01, 672, 774.44, 523.27),
    W=1862.87 * 9.81,
    B=1028 * 9.81 * 1.83826,
    r_b=_vector(0, 0, 0.3),
    down=ENU,
)
"""uuv_simulator; the added mass is asymmetric by .001 in one place of the source, here its symmetric part."""

LRAUV = Body(
    name="lrauv",
    m=148.367,
    r_g=_vector(0, 0, 0),
    I_g=np.diag([3.0, 41.980233, 41.980233]),
    M_A=np.diag([4.876161, 126.324739, 126.324739, 0, 33.46, 33.46]),
    D_l=np.zeros(6),
    D_q=_vector(6.2282, 601.27, 601.27, 0.1916, 632.698957, 632.698957),
    W=148.367 * 9.8,
    B=148.367 * 9.8,
    r_b=_vector(0, 0, 0.007),
    down=ENU,
    added_coriolis=False,
)
"""Tethys with its nose along +x (its model points to -x), neutral, without the Coriolis terms of its added mass."""

REALISTIC = replace(BLUEROV2, name="bluerov2_realistic_inertia", I_g=np.diag([0.21, 0.245, 0.245]))
"""The same with the inertia of Einarsson and Lipenitis 2020."""

HEAVY_WU2018 = replace(WU2018, name="bluerov2_heavy_wu2018", I_g=np.diag([0.16, 0.16, 0.16]))
"""Wu 2018 on a heavy."""

ALL = {b.name: b for b in (BLUEROV2, REALISTIC, WU2018, VON_BENZON, HEAVY_WU2018, REXROV, LRAUV)}

H = float(np.sqrt(0.5))

THRUSTERS: dict[str, list[tuple[tuple[float, float, float], tuple[float, float, float]]]] = {
    # name: (position, direction of the force for a positive command), in the frame of the vehicle's source
    "bluerov2": [
        ((0.1355, -0.1, -0.0725), (H, H, 0)),
        ((0.1355, 0.1, -0.0725), (H, -H, 0)),
        ((-0.1475, -0.1, -0.0725), (H, -H, 0)),
        ((-0.1475, 0.1, -0.0725), (H, H, 0)),
        ((0.0025, -0.1105, -0.005), (0, 0, 1)),
        ((0.0025, 0.1105, -0.005), (0, 0, -1)),
    ],
    "bluerov2_heavy": [
        ((0.156, 0.111, 0.085), (H, -H, 0)),
        ((0.1564, -0.1104, 0.085), (H, H, 0)),
        ((-0.1566, 0.1102, 0.085), (-H, -H, 0)),
        ((-0.156, -0.111, 0.085), (-H, H, 0)),
        ((0.12, 0.218, 0), (0, 0, -1)),
        ((0.1204, -0.2178, 0), (0, 0, -1)),
        ((-0.1208, 0.2176, 0), (0, 0, -1)),
        ((-0.12, -0.218, 0), (0, 0, -1)),
    ],
}

REXROV_ALLOCATION = np.array(
    [
        [0.159743, 0.159743, -0.159742, -0.159742, 0.707107, 0.707107, -0.707107, -0.707107],
        [-0.213610, 0.213610, -0.213610, 0.213610, 0.707107, -0.707107, 0.707107, -0.707107],
        [0.963770, 0.963770, 0.963770, 0.963770, 0, 0, 0, 0],
        [0.435232, -0.435232, 0.435232, -0.435232, -0.091217, 0.091217, -0.091217, 0.091217],
        [0.943093, 0.943093, -0.943093, -0.943093, 0.091217, 0.091217, -0.091217, -0.091217],
        [0.136889, -0.136889, -0.136888, 0.136888, -0.648799, 0.648799, 0.648799, -0.648799],
    ]
)
"""TAM.yaml of uuv_simulator, six digits."""


def allocation(name: str) -> Array:
    """Wrench (6, n_u) per newton of each thruster, in the frame of the vehicle's source."""
    columns = [np.concatenate([e, np.cross(r, e)]) for r, e in THRUSTERS[name]]
    return np.array(columns).T
