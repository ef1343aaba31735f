"""Make the loops over episodes of each disturbance, as `auvbench.tasks.loops` makes the loops of tasks."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from auvbench.tasks import rows
from auvbench.tasks.loops import Maker, plain_function, row_compiler

_LOOPS = {
    "draw": """
def {name}(indices, episodes, state, parameters, stream):
    p = parameters[0]
    for k in range(indices.shape[0]):
        i = indices[k]
        d = state[i]
        {clear}
        draw(episodes[i], d, p, stream)
""",
    "before": """
def {name}(episodes, state, parameters, stream):
    p = parameters[0]
    for i in range(episodes.shape[0]):
        before(episodes[i], state[i], p, stream)
""",
    "act": """
def {name}(episodes, state, parameters, command, effectiveness):
    p = parameters[0]
    command, effectiveness = borrowed(command), borrowed(effectiveness)
    for i in range(episodes.shape[0]):
        act(episodes[i], state[i], p, command[i], effectiveness[i])
""",
    "push": """
def {name}(
    episodes, state, parameters, pose, velocity, action, previous, force, power, water, duration, wrench
):
    p = parameters[0]
    action, previous, force, wrench = borrowed(action), borrowed(previous), borrowed(force), borrowed(wrench)
    for i in range(episodes.shape[0]):
        v = vehicle(i, pose, velocity, action, previous, force, power)
        push(episodes[i], state[i], p, v, water[i], duration, wrench[i])
""",
    "read": """
def {name}(indices, episodes, state, parameters, stream, offset):
    p = parameters[0]
    offset = borrowed(offset)
    for k in range(indices.shape[0]):
        i = indices[k]
        read(episodes[i], state[i], p, stream, offset[i])
""",
}


@cache
def of_disturbance(
    functions: tuple[tuple[str, Callable[..., Any]], ...],
    own: tuple[tuple[Any, ...], ...],
    interpreted: bool,
) -> dict[str, Callable[..., None]]:
    """Return a loop over episodes for each function of a disturbance, by the function's name.

    Args:
        functions: functions for one episode, by name.
        own: fields of the disturbance's state: (name, type) or (name, type, shape).
        interpreted: whether to leave the loops and functions uncompiled, so that Python checks each index.
    """
    clear = [f"d.{name} = 0" if not shape else f"d.{name}[:] = 0" for name, _, *shape in own]
    made = {}
    for name, function in functions:
        one = plain_function(function)
        names = {name: row_compiler(interpreted)(one), "vehicle": rows.vehicle}
        made[name] = Maker([one], names, interpreted)(f"{name}_disturbance", _LOOPS[name], {"clear": clear})
    return made
