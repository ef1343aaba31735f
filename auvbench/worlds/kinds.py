"""Define the kinds of solids. This module imports no compiled code."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Solids = NDArray[Any]
"""Array (n,) of records of `solids.SOLID`"""

SPHERE, CAPSULE, CYLINDER, BOX, PLANE, TERRAIN = range(6)
KINDS = ("sphere", "capsule", "cylinder", "box", "plane", "bottom")
"""names of the kinds"""
NOTHING = -1
"""Index returned if no solid is found"""
