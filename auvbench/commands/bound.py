"""`auvbench bound`: how soon a vehicle could reach the waypoints of a protocol at all."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvbench.errors import RunError, UserError, closest

if TYPE_CHECKING:
    from auvbench.config.schema import Protocol
    from auvbench.evaluation.bounds.files import Limits

USAGE = """\
usage: auvbench bound [protocol=NAME] [vehicle=NAME] [KEY=VALUE ...] [--check]

Computes the limit of each scenario of a protocol: the fewest steps in which the vehicle could be inside the goal,
knowing everything, without noise, by optimal control and checked in the simulator; and a number of steps below which
it is proven that none arrives. auvbench report sets agents in relation to it (time over best known). docs/bound.md

  protocol=NAME   test (default), or another that fixes the frequency
  vehicle=NAME    bluerov2 (default), or another vehicle that has thrusters alone
  workers=N       searches at once (default: one per core); does not change what is found
  passes=N        1: each scenario by itself; 2 (default): once more from what its neighbours found
  output=DIR      where the limits are written and looked for (default: outputs/bounds)
  force=true      compute again what is there already
  --check         compute nothing: play the commands behind the limits that are there once more in the simulator

What was found is kept: the same command goes on where it was interrupted. Needs CasADi: pip install 'auvbench[mpc]'.

examples:
  auvbench bound protocol=test vehicle=bluerov2_heavy
  auvbench bound protocol=test --check
"""

KEYS = ("protocol", "vehicle", "simulator", "workers", "passes", "output", "force")
FLAGS = ("--check", "--help")
OUTPUT = "outputs/bounds"


def main(arguments: Sequence[str]) -> int:
    if any(a in ("-h", "--help") for a in arguments):
        print(USAGE, end="")
        return 0
    checks = "--check" in arguments
    words = [word for word in arguments if word != "--check"]
    _refuse(words)
    own, run, test = _sorted(words)
    passes = _passes(own.get("passes", "2"))
    root = Path(own.get("output", OUTPUT))
    from auvbench.config.compose import compose
    from auvbench.config.validate import evaluate_config, train_config

    settings = evaluate_config(compose("evaluate", test))
    composed = compose("train", run)
    train_config(composed)
    from omegaconf import OmegaConf

    plain = OmegaConf.to_container(composed, resolve=True)
    assert isinstance(plain, dict)
    config = {str(key): value for key, value in plain.items()}
    if checks:
        return _check(settings.protocol, config, root)
    if not settings.force and (there := _there(settings.protocol, config, root)) is not None:
        print(_summary(there))
        print("These limits are there already (force=true computes them again).")
        return 0
    return _compute(settings.protocol, config, root, settings.workers, passes, force=settings.force)


def _refuse(words: Sequence[str]) -> None:
    for word in words:
        if word.startswith("-"):
            raise UserError(f"{word}: bound has no such flag; {closest(word, FLAGS)}")
        key, separator, _ = word.partition("=")
        if not separator:
            raise UserError(f"{word}: bound takes key=value; keys: {', '.join(KEYS)} (auvbench bound --help)")
        if key.partition(".")[0] not in KEYS:
            raise UserError(f"{key}: bound has no such key; {closest(key, KEYS)}")


def _sorted(words: Sequence[str]) -> tuple[dict[str, str], list[str], list[str]]:
    """Keys of this command, those of a run's configuration, and those of a test's."""
    own, run, test = {}, [], []
    for word in words:
        key, _, value = word.partition("=")
        if key in ("passes", "output"):
            own[key] = value
        elif key.partition(".")[0] in ("vehicle", "simulator"):
            run.append(word)
        else:
            test.append(word)
    return own, run, test


def _passes(text: str) -> int:
    if text not in ("1", "2"):
        raise UserError(f"passes={text}: must be 1 or 2")
    return int(text)


def _there(protocol: Protocol, config: dict[str, Any], root: Path) -> Limits | None:
    from auvbench.evaluation.bounds.files import find
    from auvbench.evaluation.protocol import circumstances, fingerprint

    wanted = fingerprint(protocol, circumstances(protocol, config))
    return find(protocol.name, str(config["vehicle"]["name"]), wanted, [root])[0]


def _compute(
    protocol: Protocol, config: dict[str, Any], root: Path, workers: int, passes: int, *, force: bool
) -> int:
    from auvbench.commands.bars import counting_bar
    from auvbench.evaluation.bounds.compute import PRELOAD, compute, eligible
    from auvbench.evaluation.bounds.files import folder_of, shipped
    from auvbench.evaluation.protocol import circumstances
    from auvbench.runs.interruption import Interrupted
    from auvbench.runs.pool import Pool
    from auvbench.vehicles.symbolic import require

    require()
    good, left_out = eligible(circumstances(protocol, config))
    total = passes * protocol.episodes * len(good)
    done = 0
    others = [] if force else [*_folders(root), *_folders(shipped())]
    with (
        counting_bar(total, f"limits of protocol {protocol.name}") as tell,
        Pool(workers, PRELOAD) as pool,
    ):
        for line in left_out:
            tell.note(f"left out: {line}")

        def told(key: Any, found: Any) -> None:
            nonlocal done
            done += 1
            step = max(1, total // 20)
            tell.line(f"{done} of {total} searches" if done % step == 0 else None)

        try:
            limits = compute(
                protocol,
                config,
                root,
                pool=pool if pool.workers > 1 else None,
                passes=passes,
                others=others,
                tell=told,
            )
        except Interrupted as interrupted:
            raise Interrupted(
                interrupted.signal,
                f"interrupted: {done} of {total} searches are kept; the same command goes on",
            ) from None
    print(_summary(limits))
    print(f"wrote {os.path.relpath(folder_of(root, protocol.name, limits.vehicle))}")
    return 0


def _folders(root: Path) -> list[Path]:
    return sorted(folder for folder in root.glob("*") if folder.is_dir()) if root.is_dir() else []


def _check(protocol: Protocol, config: dict[str, Any], root: Path) -> int:
    from auvbench.evaluation.bounds.compute import tried
    from auvbench.evaluation.bounds.files import folder_of, read, shipped
    from auvbench.evaluation.protocol import circumstances, fingerprint

    vehicle = str(config["vehicle"]["name"])
    wanted = fingerprint(protocol, circumstances(protocol, config))
    wrong = checked = 0
    for place in (root, shipped()):
        folder = folder_of(place, protocol.name, vehicle)
        limits = read(folder, commands=True)
        if limits is None:
            continue
        if limits.fingerprint != wanted:
            raise RunError(f"{folder}: of other scenarios ({limits.fingerprint}, not {wanted})")
        lines = tried(limits, protocol, config)
        for line in lines:
            print(f"{folder}: {line}")
        count = sum(len(c.steps) for c in limits.conditions)
        print(f"{folder}: {count - len(lines)} of {count} limits arrive in the simulator as they say")
        checked, wrong = checked + 1, wrong + len(lines)
    if not checked:
        raise UserError(
            f"no limits of protocol {protocol.name} for {vehicle}; auvbench bound protocol={protocol.name} "
            f"vehicle={vehicle} computes them"
        )
    return 1 if wrong else 0


def _summary(limits: Limits) -> str:
    import numpy as np

    lines = []
    for c in limits.conditions:
        seconds = c.steps / c.frequency
        lines.append(
            f"protocol {limits.protocol}, {c.name}, {limits.vehicle}: {len(c.steps)} scenarios, limit {seconds.mean():.2f} s "
            f"on average ({c.steps.mean():.1f} steps at {c.frequency:g} Hz), proven to be at least "
            f"{c.least.mean() / c.frequency:.2f} s; median of limit over proven {np.median(c.steps / c.least):.2f}"
        )
    return "\n".join(lines)
