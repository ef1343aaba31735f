"""`auvbench bound`: compute lower and upper bounds of the time to the waypoints of a protocol."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvbench.errors import UserError, closest
from auvbench.grammar import Parser

if TYPE_CHECKING:
    from auvbench.config.schema import Protocol
    from auvbench.evaluation.bounds.files import Limits

KEYS = ("protocol", "vehicle", "simulator", "output")
OUTPUT = "outputs/bounds"


def main(arguments: Sequence[str]) -> int:
    options = parser().read(arguments, overrides=True)
    root, run, test = _sorted(options.words)
    from auvbench.config.compose import compose
    from auvbench.config.validate import evaluate_config, resolved, train_config

    protocol = evaluate_config(compose("evaluate", test)).protocol
    composed = compose("train", run)
    train_config(composed)
    config = resolved(composed)
    if not options.force and (existing := _existing_limits(protocol, config, root)) is not None:
        print(_summary(existing))
        print("These bounds exist already (--force computes them again).")
        return 0
    return _compute(protocol, config, root, options.workers)


def parser() -> Parser:
    parser = Parser(
        prog="auvbench bound",
        description="Computes two bounds of the shortest time to the waypoint in each scenario of a "
        "protocol: the time of the best "
        "trajectory that optimal control found (started from PID, MPC and a straight line, and replayed in "
        "the simulator), and a "
        "time that no trajectory can beat. auvbench report compares agents with the first bound "
        "(docs/bound.md). After an "
        "interruption, run the same command to continue. Needs CasADi: pip install 'auvbench[mpc]'.",
        epilog="example: auvbench bound protocol=test vehicle=bluerov2_heavy",
        keys=KEYS,
        workers="searches",
    )
    add = parser.add_argument
    add(
        "words",
        nargs="*",
        metavar="KEY=VALUE",
        help=f"protocol=NAME, vehicle=NAME, output=DIR (default: {OUTPUT})",
    )
    add("--force", action="store_true", help="search again")
    return parser


def _sorted(words: Sequence[str]) -> tuple[Path, list[str], list[str]]:
    """Return the output folder, the overrides of a run's configuration, and the overrides of a test.

    Raises:
        UserError: an unknown key.
    """
    output = OUTPUT
    run: list[str] = []
    test: list[str] = []
    for word in words:
        key, _, value = word.partition("=")
        group = key.partition(".")[0]
        if group == "task":
            raise UserError(
                f"{word}: bounds can be computed only for the waypoint task with its default values; leave this key out "
                "(docs/bound.md)"
            )
        if group not in KEYS:
            raise UserError(f"{word}: bound has no such key; {closest(key, KEYS)}")
        if key == "output":
            output = value
        else:
            (run if group in ("vehicle", "simulator") else test).append(word)
    return Path(output), run, test


def _existing_limits(protocol: Protocol, config: dict[str, Any], root: Path) -> Limits | None:
    from auvbench.evaluation.bounds.files import find
    from auvbench.evaluation.protocol import fingerprint, resolve_conditions

    digest = fingerprint(protocol, resolve_conditions(protocol, config))
    return find(protocol.name, str(config["vehicle"]["name"]), digest, [root])[0]


def _compute(protocol: Protocol, config: dict[str, Any], root: Path, workers: int) -> int:
    from auvbench.commands.progress import RunBar
    from auvbench.evaluation.bounds.compute import PRELOAD, compute, eligible
    from auvbench.evaluation.bounds.files import folder_of
    from auvbench.evaluation.protocol import resolve_conditions
    from auvbench.runs.interruption import Interrupted
    from auvbench.runs.pool import Pool
    from auvbench.vehicles.symbolic import require

    require()
    good, left_out = eligible(resolve_conditions(protocol, config))
    total = protocol.episodes * len(good)
    done = 0
    with (
        RunBar(total, f"bounds of protocol {protocol.name}") as tell,
        Pool(workers, PRELOAD) as pool,
    ):
        for line in left_out:
            tell.note(f"skipped: {line}")

        def report(bound: Any) -> None:
            nonlocal done
            done += 1
            step = max(1, total // 20)
            tell.line(f"{done} of {total} searches" if done % step == 0 else None)

        try:
            limits = compute(protocol, config, root, pool, report)
        except Interrupted as interrupted:
            raise Interrupted(
                interrupted.signal,
                f"interrupted: {done} of {total} searches are saved; run the same command to continue",
            ) from None
    print(_summary(limits))
    print(f"wrote {os.path.relpath(folder_of(root, protocol.name, limits.about.vehicle))}")
    return 0


def _summary(limits: Limits) -> str:
    import numpy as np

    lines = []
    for name in limits.conditions():
        bounds = limits.condition(name)
        steps, least = np.array([(b.steps, b.least_steps) for b in bounds]).T
        frequency = bounds[0].frequency_hz
        lines.append(
            f"protocol {limits.about.protocol}, {name}, {limits.about.vehicle}: {len(bounds)} scenarios, mean best known time "
            f"{steps.mean() / frequency:.2f} s ({steps.mean():.1f} steps at {frequency:g} Hz), mean proven lower bound "
            f"{least.mean() / frequency:.2f} s; median ratio of best known time to lower bound {np.median(steps / least):.2f}"
        )
    return "\n".join(lines)
