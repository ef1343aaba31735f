"""Write docs/configuration.md: every configuration key with its default, its range and its meaning.

`python -m tests.configuration_page` in the root of the repository. Defaults and meanings come from `conf/`, ranges from
the schema.
"""

from __future__ import annotations

import dataclasses
import math
import re
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from auvbench.config import navigation, ranges, schema, simulation, tuning
from auvbench.config.validate import limit
from auvbench.registry import AGENTS, DISTURBANCES, FILTERS, LAUNCHERS, REWARDS, SIMULATORS, TASKS

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "configuration.md"

INTRODUCTION = """\
# Configuration keys

Generated from `conf/` and the schema by `python -m tests.configuration_page`. Type `key=value` after a command
([grammar](grammar.md)). `auvbench train --cfg job` prints a composed configuration. `vehicle` is a
[sheet](adding-a-vehicle.md).
"""

SECTIONS: tuple[tuple[str, str, str, type], ...] = (
    ("Runs: `train`", "train.yaml", "", schema.TrainConfig),
    *((f"`task={name}`", f"task/{name}.yaml", "task.", TASKS[name].schema) for name in TASKS.own),
    *((f"`reward={name}`", f"reward/{name}.yaml", "reward.", REWARDS[name].schema) for name in REWARDS.own),
    ("Range sensors: `task.range`", "range/default.yaml", "task.range.", ranges.Ranges),
    ("`sensors=bluerov2`", "sensors/bluerov2.yaml", "sensors.", navigation.Sensors),
    ("`sensors=dvl_a50`", "sensors/dvl_a50.yaml", "sensors.", navigation.Sensors),
    ("`sensors=dvl_usbl`", "sensors/dvl_usbl.yaml", "sensors.", navigation.Sensors),
    ("`sensors=gnss`", "sensors/gnss.yaml", "sensors.", navigation.Sensors),
    ("`sensors=team`", "sensors/team.yaml", "sensors.", navigation.Sensors),
    ("`navigation=ekf`", "navigation/ekf.yaml", "navigation.", navigation.Ekf),
    ("`navigation=ekf_model`", "navigation/ekf_model.yaml", "navigation.", navigation.EkfModel),
    (
        "`navigation=dead_reckoning`",
        "navigation/dead_reckoning.yaml",
        "navigation.",
        navigation.DeadReckoning,
    ),
    ("Safety filter: `filter=cbf`", "filter/cbf.yaml", "filter.", FILTERS["cbf"].keys),
    ("Step", "step/default.yaml", "step.", schema.Step),
    ("Noise", "noise/thesis.yaml", "noise.", schema.Noise),
    ("Disturbance", "disturbance/none.yaml", "disturbance.", schema.Disturbance),
    *(
        (
            f"`disturbance={name}`",
            f"disturbance/{name}.yaml",
            "disturbance.",
            schema.with_disturbances(((name, DISTURBANCES[name].keys),)),
        )
        for name in ("tether", "identified")
    ),
    ("Training", "train/default.yaml", "train.", schema.Train),
    *(
        (f"`simulator={name}`", f"simulator/{name}.yaml", "simulator.", SIMULATORS[name].schema)
        for name in SIMULATORS.own
    ),
    *(
        (f"`launcher={name}`", f"launcher/{name}.yaml", "launcher.", LAUNCHERS[name].schema)
        for name in LAUNCHERS.own
    ),
    ("Tests: `evaluate`", "evaluate.yaml", "", schema.EvaluateConfig),
    ("Protocol", "protocol/test.yaml", "protocol.", schema.Protocol),
    ("Searches: `tune`", "tune.yaml", "", tuning.TuneConfig),
    ("Open loop: `simulate`", "simulate.yaml", "", simulation.Simulation),
    *((f"`algo={name}`", f"algo/{name}.yaml", "algo.", AGENTS[name].schema) for name in AGENTS.own),
)
NOT_KEYS = ("defaults", "hydra")
FIXED = ("name", "agent", "tuned")
"""keys that the choice of a file sets, and what `auvbench tune` writes"""

_LINE = re.compile(r"(?P<indent> *)(?P<key>\w+):(?: +(?P<value>[^#\s][^#]*?))?(?: +# ?(?P<comment>.*))?$")


@dataclasses.dataclass(frozen=True)
class Key:
    """One line of a YAML file."""

    path: str
    default: str
    meaning: str


def keys(path: Path) -> Iterator[Key]:
    """Yield the keys of a YAML file of `conf/` in order; a block without a value is a prefix of the keys below it."""
    parents: list[tuple[int, str]] = []
    above: list[str] = []
    lines = _whole(path.read_text(encoding="utf-8"))
    for number, line in enumerate(lines):
        if line.lstrip().startswith("#"):
            above.append(line.strip().lstrip("# "))
            continue
        match = _LINE.fullmatch(line)
        if match is None:
            above = []
            continue
        indent = len(match["indent"])
        parents = [parent for parent in parents if parent[0] < indent]
        names = [*(name for _, name in parents), match["key"]]
        is_block = match["value"] is None and _indent(lines, number + 1) > indent
        if names[0] not in NOT_KEYS and not is_block:
            yield Key(".".join(names), match["value"] or "", match["comment"] or " ".join(above))
        parents.append((indent, match["key"]))
        above = []


def _whole(text: str) -> list[str]:
    """Return the lines of a YAML file; a comment that goes on below, in the same column, is one line."""
    lines: list[str] = []
    for line in text.splitlines():
        column = lines[-1].find(" # ") + 1 if lines else 0
        if column and line.startswith(" " * column + "# "):
            lines[-1] += f" {line.strip('# ')}"
        else:
            lines.append(line)
    return lines


def _indent(lines: list[str], number: int) -> int:
    following = [line for line in lines[number:] if line.strip() and not line.lstrip().startswith("#")]
    return len(following[0]) - len(following[0].lstrip()) if following else 0


def allowed(kind: type, path: str) -> str:
    """Return the range or the names that the schema allows for a key; '' where it says neither."""
    for part in path.split(".")[:-1]:
        kind = _class(typing.get_type_hints(kind).get(part))
        if kind is object:
            return ""
    found = [field for field in dataclasses.fields(kind) if field.name == path.rpartition(".")[2]]
    if not found:
        return ""
    rule = found[0].metadata
    choices = rule.get("choices", ())
    choices = choices() if callable(choices) else choices
    if len(choices) > 1:
        return ", ".join(f"`{name}`" for name in choices)
    if "low" in rule:
        return _range(rule["low"], rule["high"], rule["open_low"])
    inner = _class(typing.get_type_hints(kind)[found[0].name])
    bounds = [f.metadata for f in dataclasses.fields(inner)] if dataclasses.is_dataclass(inner) else []
    if bounds and all("low" in bound for bound in bounds):
        return _range(bounds[0]["low"], bounds[0]["high"], bounds[0]["open_low"])
    return ""


def _class(hint: Any) -> type:
    """Return the class of a field's annotation, without None."""
    options = [option for option in typing.get_args(hint) if option is not type(None)] or [hint]
    return options[0] if isinstance(options[0], type) else object


def _range(low: float, high: float, open_low: bool) -> str:
    lower = "" if low == -math.inf else f"{'>' if open_low else '≥'} {limit(low, least=True, digits=6)}"
    upper = "" if high == math.inf else f"≤ {limit(high, least=False, digits=6)}"
    return ", ".join(part for part in (lower, upper) if part)


def page() -> str:
    """Return the page."""
    parts, meanings = [INTRODUCTION], dict[str, str]()
    for title, file, prefix, kind in SECTIONS:
        lines = ["| key | default | allowed | meaning |", "|---|---|---|---|"]
        for key in keys(ROOT / "conf" / file):
            name = prefix + key.path
            if prefix and key.path in FIXED:
                continue
            meaning = meanings.setdefault(name, key.meaning)  # a second file need not explain a key again
            cells = (f"`{name}`", f"`{key.default}`", allowed(kind, key.path), key.meaning or meaning)
            lines.append(f"| {' | '.join(_cell(text) for text in cells)} |")
        parts.append(
            "\n".join(
                [f"## {title}", "", *lines, ""] if len(lines) > 2 else [f"## {title}", "", "No keys.", ""]
            )
        )
    return "\n".join(parts)


def _cell(text: str) -> str:
    return text if text.startswith("`") else text.replace("|", "\\|").replace("<", "&lt;")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"wrote {PAGE}")
