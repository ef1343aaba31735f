"""How fast a vehicle may react, for its motion to be computed in an acceptable time."""

from __future__ import annotations

from auvbench.errors import VehicleError

SHORTEST = 1e-5
"""s of the shortest time constant; those of real vehicles have some milliseconds (docs/physics.md)"""


def refuse_stiff_vehicle(name: str, shortest: float) -> None:
    """Refuses a vehicle whose damping acts so fast that the physics step would have to be next to nothing.

    Args:
        name: of the vehicle, for the message.
        shortest: s, its shortest time constant, or that of the fastest vehicle that may be drawn.

    Raises:
        VehicleError: it is shorter than `SHORTEST`, or no number.
    """
    if not shortest >= SHORTEST:
        raise VehicleError(
            f"vehicle {name}: its damping acts within {shortest:.3g} s, so that each second would take more than "
            f"{1 / SHORTEST:,.0f} physics steps: its damping is too large for its mass (auvbench vehicles {name}); "
            f"the shortest time constant must be at least {SHORTEST:g} s"
        )
