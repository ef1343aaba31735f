"""Gymnasium's three ways to begin the next episode, in versions that name them and in 1.0, which does not yet."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING

from auvbench.errors import ConfigError, closest

if TYPE_CHECKING:
    from gymnasium.vector import AutoresetMode
else:
    try:
        from gymnasium.vector import AutoresetMode
    except ImportError:

        class AutoresetMode(Enum):
            """As in Gymnasium 1.1."""

            NEXT_STEP = "NextStep"
            SAME_STEP = "SameStep"
            DISABLED = "Disabled"


__all__ = ["AutoresetMode", "mode"]


def mode(given: AutoresetMode | str) -> AutoresetMode:
    """The mode of a name, `NEXT_STEP` or `NextStep`.

    Raises:
        ConfigError: there is no such mode.
    """
    if isinstance(given, AutoresetMode):
        return given
    for known in AutoresetMode:
        if given in (known.name, known.value):
            return known
    raise ConfigError(
        f"autoreset_mode={given}: unknown; {closest(str(given), [m.name for m in AutoresetMode])}"
    )
