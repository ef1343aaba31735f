"""Make the loops over episodes of each task and of the observation from source text.

numba stores compiled code only for functions of a module; closures, and functions given as arguments, would compile
again in every process. So each loop is a source text that names the functions of one task and one reward. The text is
executed in the task's module. numba finds stored code by a function's name, and would confuse two loops with the same
name. The name therefore contains a digest of the source files of all functions that the loop calls directly; `compiled`
adds the source files of the functions that the loop calls indirectly.
"""

from __future__ import annotations

import hashlib
import math
import re
import zlib
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NamedTuple

from auvbench import blocks
from auvbench.config.navigation import READS
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.random import BLOCK, SENSOR, normal4, uniform4
from auvbench.registry import BLOCKS, resolve
from auvbench.tasks import rows

Functions = Mapping[str, Callable[..., Any]]

_DRAW = """
def {name}(indices, episodes, preview, parameters, stream, pose):
    p = parameters[0]
    for k in range(indices.shape[0]):
        i = indices[k]
        e = episodes[i]
        begin(e)
        {clear}
        start(e, draw(e, p, stream), p, pose[k])
        {preview}
"""

_STEP = """
def {name}(
    first, stop, pose, velocity, action, previous, force, power, episodes, preview, parameters, prices, rewards,
    {surroundings}
):
    p, q = parameters[0], prices[0]
    action, previous, force, preview = borrowed(action), borrowed(previous), borrowed(force), borrowed(preview)
    {borrow}
    ended = 0
    for i in range(first, stop):
        e = episodes[i]
        v = vehicle(i, pose, velocity, action, previous, force, power)
        e.steps += 1
        {refer}
        {look}
        measure(e, v)
        if not isfinite(e.distance):
            return -1 - i
        {turn}
        {touch}
        e.outcome = step(e, v, p)
        {collide}
        r = reward(e, v, q)
        {sight}
        rewards[i] = r
        finish(e, v, r, p)
        {preview}
        if e.outcome >= 0:
            ended += 1
    return ended
"""

_RELOCATE = """
def {name}(indices, episodes, preview, parameters):
    p = parameters[0]
    for k in range(indices.shape[0]):
        i = indices[k]
        e = episodes[i]
        relocate(e, p)
        {preview}
"""

_BELIEVE = """
def {name}(
    first, stop, pose, velocity, action, previous, force, power, episodes, preview, parameters
):
    p = parameters[0]
    action, previous, force, preview = borrowed(action), borrowed(previous), borrowed(force), borrowed(preview)
    for i in range(first, stop):
        e = episodes[i]
        e.steps += 1
        v = vehicle(i, pose, velocity, action, previous, force, power)
        {refer}
        {preview}
"""

_OBSERVE = """
def {name}(
    indices, pose, velocity, offset, previous, episodes, preview, parameters, codes, sizes, stream, observation,
    {sensed}
):
    p = parameters[0]
    previous, preview, observation = borrowed(previous), borrowed(preview), borrowed(observation)
    {owned}
    both = p.both_signs > 0
    for k in range(indices.shape[0]):
        i = indices[k]
        e = episodes[i]
        nx, ny, nz, turned = 0.0, 0.0, 0.0, offset[i, 3]
        if p.position_noise_high > 0.0 or p.yaw_noise_high > 0.0:
            a, b, c, d = uniform4(e.seed, SENSOR | stream, 0, e.steps, e.episode, e.environment)
            nx = noise(a, p.position_noise_low, p.position_noise_high, both)
            ny = noise(b, p.position_noise_low, p.position_noise_high, both)
            nz = noise(c, p.position_noise_low, p.position_noise_high, both)
            turned += noise(d, p.yaw_noise_low, p.yaw_noise_high, both)
        m = reading(
            e,
            p,
            (pose[i, 0], pose[i, 1], pose[i, 2]),
            (pose[i, 3], pose[i, 4], pose[i, 5], pose[i, 6]),
            (velocity[i, 0], velocity[i, 1], velocity[i, 2]),
            (velocity[i, 3], velocity[i, 4], velocity[i, 5]),
            (offset[i, 0], offset[i, 1], offset[i, 2]),
            (nx, ny, nz),
            turned,
            previous[i],
            preview[i],
            stream,
        )
        {scene}
        newest = observation.shape[1] // p.history
        if p.history > 1:
            for column in range(observation.shape[1] - 1, newest - 1, -1):
                observation[i, column] = observation[i, column - newest]
        at = 0
        for block in range(codes.shape[0]):
            code = codes[block]
            out = observation[i, at : at + sizes[block]]
            {blocks}
            at += sizes[block]
        if p.history > 1 and e.steps == 0:
            for column in range(newest, observation.shape[1]):
                observation[i, column] = observation[i, column - newest]
"""

_SENSED = {
    "sensed": "seats, counts, solids, heights, states, memories, settings, rays,",
    "owned": "solids, heights = borrowed(solids), borrowed(heights)",
    "scene": "seen = scene(solids[i], counts[i], heights, e.steps * p.duration, seats[i], stream)",
}
"""Lines of the observing loop that range sensors need"""

_OF_EVERY_TASK: Functions = {
    **{f.__name__: f for f in (rows.begin, rows.start, rows.vehicle, rows.measure, rows.finish)},
    "turn_own": rows.turn,
    "turn_to": rows.turn_to,
    "isfinite": math.isfinite,
}


_IN_WORLD = {
    "surroundings": "solids, heights, hull,",
    "borrow": "solids, heights = borrowed(solids), borrowed(heights)",
    "touch": "touch(e, v, p, solids[i], heights, hull[0])",
    "collide": "e.outcome = COLLISION if e.contact > 0 else e.outcome",
}
"""Lines of the stepping loop that a world with solids needs"""


class Loops(NamedTuple):
    """Loops of a task and a reward; the source texts above show their arguments."""

    draw: Callable[..., None]
    step: Callable[..., int]
    relocate: Callable[..., None] | None
    """writes the reference of an episode whose drawn start was replaced; None if the task's reference does not depend
    on the start"""
    believe: Callable[..., None]
    """Advances the believed episodes by one step"""


def of_task(
    functions: Functions,
    reward: Callable[..., float],
    own: tuple[tuple[Any, ...], ...],
    *,
    has_yaw: bool,
    solid: bool = False,
    interpreted: bool = False,
) -> Loops:
    """Return the loops of a task.

    Args:
        functions: the task's `draw` and `step`; `refer`, `look`, `preview_row` and `relocate`, if the task has them; the reward's
            `sight`, if the reward has it.
        reward: function that computes the reward of one step.
        own: the task's own fields: (name, type) or (name, type, shape).
        has_yaw: whether the reference has its own yaw.
        solid: whether there are solids in the water.
        interpreted: whether to leave the loops and the functions of task and reward uncompiled, so that Python checks each index.
    """
    clear = tuple(f"e.{name} = 0" if not shape else f"e.{name}[:] = 0" for name, _, *shape in own)
    return _of_task(tuple(functions.items()), reward, clear, has_yaw, solid, interpreted)


@cache
def _of_task(
    functions: tuple[tuple[str, Callable[..., Any]], ...],
    reward: Callable[..., float],
    clear: tuple[str, ...],
    has_yaw: bool,
    solid: bool,
    interpreted: bool,
) -> Loops:
    """Make the loops once per process: reading compiled code from disk costs more than an episode."""
    named = {name: plain_function(function) for name, function in functions}
    pays = plain_function(reward)
    compile_row = row_compiler(interpreted)
    compiled_rows = {name: compile_row(function) for name, function in {**named, "reward": pays}.items()}
    # A bearing costs as much as the rest of a step, so it is computed only if the reward reads the yaw error.
    turn = ["turn_own(e, v)"] if has_yaw else ["turn_to(e, v)"] if _mentions(pays, "yaw_error") else []
    lines = {
        "clear": clear,
        "refer": ["refer(e, v, p)"] if "refer" in named else [],
        "turn": turn,
        "preview": ["preview_row(e, p, preview[i])"] if "preview_row" in named else [],
        "look": ["look(e, v, p, solids[i], heights)"] if solid and "look" in named else [],
        "sight": ["r += sight(e, v, q, solids[i], heights)"] if solid and "sight" in named else [],
        **dict.fromkeys(_IN_WORLD, ()),
    }
    names: dict[str, Any] = {**_OF_EVERY_TASK, **compiled_rows}
    if solid:
        from auvbench.tasks.worlds.contact import touch

        lines |= {key: [line] for key, line in _IN_WORLD.items()}
        names["COLLISION"] = rows.COLLISION
        names["touch"] = compile_row(plain_function(touch))
    make = Maker([*named.values(), pays], names, interpreted)
    return Loops(
        make("draw", _DRAW, lines),
        make("step", _STEP, lines),
        make("relocate", _RELOCATE, lines) if "relocate" in named else None,
        make("believe", _BELIEVE, lines),
    )


def observed(names: Iterable[str]) -> tuple[blocks.BlockSpec, ...]:
    """Return the blocks in the order of their codes: common blocks of auvbench, then the other blocks of `names`.

    Common blocks are not sensors and do not read an estimate, a team or a task's own fields. All of them are in the result, so that
    most tasks share one compiled function.
    """
    special = {READS, "task", "team"}
    own = [name for name in BLOCKS.own if not BLOCKS[name].sensor and not special & {*BLOCKS[name].reads}]
    return tuple(BLOCKS[name] for name in (*own, *sorted(set(names) - {*own})))


@cache
def observe(specs: tuple[blocks.BlockSpec, ...], *, interpreted: bool = False) -> Callable[..., None]:
    """Return the function that writes observations.

    Args:
        specs: blocks in the order of their codes (`observed`).
        interpreted: whether to leave the function uncompiled, so that Python checks each index.
    """
    compile_row = row_compiler(interpreted)
    own = _with_compiled(vars(blocks), {}, compile_row)
    named = {"reading": own["reading"]}
    lines = []
    sensors: list[Any] = []
    for code, spec in enumerate(specs):
        lines.append(f"{'el' if code else ''}if code == {code}:")
        if spec.sensor:
            j = len(sensors)
            sensors.append(plain_function(resolve(spec.sensor).sense))
            named[f"sense_{code}"] = compile_row(sensors[j])
            lines.append(
                f"    sense_{code}(e, states[{j}][i], memories[{j}][i], settings[{j}][0], rays[{j}], seen, out)"
            )
            continue
        namespace = own
        if spec.name not in BLOCKS.own:
            lines.append(
                "    out[:] = nan"
            )  # so that the checks notice a number that the block does not write
            module = spec.write.__globals__
            replacements = (
                {} if module is vars(blocks) else {id(vars(blocks)[name]): own[name] for name in own}
            )
            noise = {id(blocks.normals): compile_row(_noise_of(spec))}
            namespace = _with_compiled(module, replacements | noise, compile_row)
        lines.append(f"    block_{code}(m, e, p, out)")
        named[f"block_{code}"] = namespace[spec.write.__name__]
    shared = {
        "nan": math.nan,
        "noise": rows.noise,
        "uniform4": uniform4,
        "SENSOR": SENSOR,
    }
    functions = [blocks.reading, *(spec.write for spec in specs if not spec.sensor), *sensors]
    around: dict[str, list[str]] = {key: [line] if sensors else [] for key, line in _SENSED.items()}
    if sensors:
        from auvbench.tasks.ranges.base import scene

        shared |= {"scene": compile_row(plain_function(scene))}
    make = Maker(functions, {**named, **shared}, interpreted, rows.__file__, rows.__name__)
    return make("observe", _OBSERVE, {"blocks": lines, **around})


class Maker:
    """Execute the source of loops in the module of the first function that the loops call."""

    def __init__(
        self,
        functions: list[Any],
        names: Mapping[str, Any],
        interpreted: bool,
        file: str = "",
        module: str = "",
    ) -> None:
        self.functions, self.interpreted = functions, interpreted
        self.names = {**names, "borrowed": (lambda array: array) if interpreted else rows.borrowed}
        self.file = file or functions[0].__code__.co_filename
        self.module = module or functions[0].__module__

    def __call__(self, kind: str, template: str, lines: Mapping[str, Iterable[str]]) -> Callable[..., Any]:
        source = _filled(template, lines)
        digest = hashlib.sha256(source.encode())
        for function in self.functions:
            digest.update(f"{function.__module__}:{function.__qualname__}".encode())
            digest.update(Path(function.__code__.co_filename).read_bytes())
        name = f"{kind}_{digest.hexdigest()[:16]}"
        namespace: dict[str, Any] = {**self.names, "__name__": self.module}
        # numba reads the file from the function's first line on and expects Python. So the function claims to begin at line 1.
        exec(compile(source.lstrip("\n").replace("{name}", name), self.file, "exec"), namespace)
        loop: Callable[..., Any] = namespace[name]
        if self.interpreted:
            return loop
        folders = {str(Path(function.__code__.co_filename).parent) for function in self.functions}
        compiler = compiled(
            "dynamics", "worlds", "tasks", "tasks/worlds", "tasks/ranges", ".", *sorted(folders)
        )
        return compiler(loop)  # type: ignore[no-any-return]


def _filled(template: str, lines: Mapping[str, Iterable[str]]) -> str:
    """Return a source in which lines replace each `{key}` that is alone on its line, with the same indentation."""

    def insert(match: re.Match[str]) -> str:
        own = lines.get(match["key"])
        return match[0] if own is None else "".join(f"{match['indent']}{line}\n" for line in own)

    return re.sub(r"(?P<indent> +)\{(?P<key>\w+)\}\n", insert, template)


def plain_function(function: Any) -> Any:
    """Return the Python function of a compiled function; a function that is not compiled is returned unchanged."""
    return getattr(function, "py_func", function)


def row_compiler(interpreted: bool) -> Callable[..., Any]:
    """Return the function that compiles a function of one episode; if `interpreted`, it leaves the function as Python."""
    return plain_function if interpreted else rows.row


def _mentions(function: Any, name: str) -> bool:
    """Return whether a function, or a function that it calls directly or indirectly, mentions `name` in its code."""
    visited: set[CodeType] = set()
    waiting = [plain_function(function)]
    while waiting:
        current = waiting.pop()
        code: CodeType = current.__code__
        if code in visited:
            continue
        visited.add(code)
        if name in code.co_names:
            return True
        called = (plain_function(current.__globals__.get(other)) for other in code.co_names)
        waiting += [other for other in called if isinstance(other, FunctionType)]
    return False


def _with_compiled(
    module: dict[str, Any], replacements: Mapping[int, Any], compile_row: Callable[..., Any]
) -> dict[str, Any]:
    """Return a copy of the namespace of a module of blocks, in which compiled copies replace the module's own functions.

    The copies call each other, not the plain functions.

    Args:
        module: namespace of the module.
        replacements: compiled functions, by the `id` of the plain function that each one replaces.
        compile_row: function that compiles a function.
    """
    namespace = dict(module)
    for name, value in module.items():
        if id(value) in replacements:
            namespace[name] = replacements[id(value)]
        elif isinstance(value, FunctionType) and value.__globals__ is module:
            copy = FunctionType(
                value.__code__, namespace, value.__name__, value.__defaults__, value.__closure__
            )
            namespace[name] = compile_row(copy)
    return namespace


FIRST_CHANNEL = 0
"""Channel of a block's first draws; `_noise_of` gives each block its own channel."""


def _normals(m: blocks.Reading, e: Any, channel: int) -> tuple[float, float, float, float]:
    """Return four standard normal numbers for a block in this step; in a package's block, this function replaces `blocks.normals`."""
    return normal4(e.seed, BLOCK | m.stream, FIRST_CHANNEL + channel, e.steps, e.episode, e.environment)


def _noise_of(spec: blocks.BlockSpec) -> Callable[..., Any]:
    """Return a copy of `_normals` with the random channels of one block."""
    first = zlib.crc32(spec.name.encode())
    return FunctionType(_normals.__code__, {**globals(), "FIRST_CHANNEL": first}, "normals")
