"""Reading a vehicle sheet: YAML with line numbers, sourced quantities, and messages that name the rule."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import yaml
from numpy.typing import NDArray

from auvbench.errors import VehicleError, closest

FloatArray = NDArray[np.float64]
Keys = tuple[str, ...]


def sheets() -> dict[str, Traversable]:
    """Vehicle sheets by name: those that come with auvbench, and those in `conf/vehicle` of the working directory.

    The latter win, as they do in Hydra's search path.
    """
    found: dict[str, Traversable] = {}
    for folder in (resources.files("auvbench.conf") / "vehicle", Path("conf") / "vehicle"):
        if folder.is_dir():
            for entry in folder.iterdir():
                if entry.name.endswith(".yaml"):
                    found[entry.name.removesuffix(".yaml")] = entry
    return dict(sorted(found.items()))


def sheet_names() -> list[str]:
    """Names of the vehicle sheets that can be loaded by name."""
    return list(sheets())


@dataclass
class Document:
    """The content of a sheet and where each key stands."""

    data: dict[str, Any]
    places: dict[Keys, str] = field(default_factory=dict)  # key path -> "file line n"
    label: str = "vehicle"
    used: set[str] = field(default_factory=set)  # sources that a quantity named

    def fail(self, path: Keys, rule: str) -> NoReturn:
        """Raise a `VehicleError` that names the place of `path` and the rule."""
        place = ""
        for length in range(len(path), 0, -1):
            if path[:length] in self.places:
                place = self.places[path[:length]] + ": "
                break
        else:
            place = f"{self.label}: "
        raise VehicleError(f"{place}{'.'.join(path)}: {rule}" if path else f"{place}{rule}")

    def section(self, path: Keys, required: Iterable[str], optional: Iterable[str] = ()) -> dict[str, Any]:
        """The mapping at `path`, which must hold `required` and may hold `optional` keys, no others."""
        node = self.mapping(path)
        valid = (*required, *optional)
        for key in node:
            if key not in valid:
                self.fail((*path, str(key)), f"unknown key; {closest(str(key), valid)}")
        for key in required:
            if key not in node:
                self.fail(path, f"key {key!r} is missing")
        return dict(node)

    def mapping(self, path: Keys) -> Mapping[str, Any]:
        node = self.get(path)
        if not isinstance(node, Mapping) or not node:
            self.fail(path, f"expected keys below it, got {node!r}")
        return node

    def get(self, path: Keys) -> Any:
        node: Any = self.data
        for key in path:
            if not isinstance(node, Mapping) or key not in node:
                self.fail(path, "is missing")
            node = node[key]
        return node

    def text(self, path: Keys, choices: Iterable[str] = ()) -> str:
        value = self.get(path)
        if not isinstance(value, str):
            self.fail(path, f"expected a text, got {value!r}")
        if choices and value not in choices:
            self.fail(path, f"{value!r} is not known; {closest(value, choices)}")
        return value

    def quantity(self, path: Keys, unit: str, shapes: tuple[tuple[int, ...], ...] = ((),)) -> FloatArray:
        """The array of a sourced quantity `{value, unit, source}` in `unit` with one of `shapes`."""
        value = self.sourced(path, unit)
        return self.numbers((*path, "value"), value, shapes)

    def number(self, path: Keys, unit: str, low: float = -math.inf, above: float = -math.inf) -> float:
        """A sourced number, at least `low` and greater than `above`."""
        value = float(self.quantity(path, unit))
        if value < low:
            self.fail((*path, "value"), f"{value:g} {unit} is out of range: it must be at least {low:g}")
        if value <= above:
            self.fail(
                (*path, "value"), f"{value:g} {unit} is out of range: it must be greater than {above:g}"
            )
        return value

    def sourced(self, path: Keys, unit: str) -> Any:
        """The value of `{value, unit, source}` after checking unit and source."""
        node = self.get(path)
        if not isinstance(node, Mapping):
            self.fail(path, f"expected value, unit and source, got {node!r}")
        if "source" not in node:
            self.fail(path, "every number names its source: key 'source' is missing")
        self.section(path, ("value", "source"), ("unit", "note"))
        if str(node.get("unit", "1")) != unit:
            self.fail(
                (*path, "unit"), f"{node.get('unit')!r} is not the unit of this quantity: it is in {unit!r}"
            )
        self.source((*path, "source"))
        return node["value"]

    def source(self, path: Keys) -> None:
        """Check that every source named at `path` is listed in `sources`."""
        named = self.get(path)
        known = self.mapping(("sources",))
        for key in named if isinstance(named, (list, tuple)) else [named]:
            if not isinstance(key, str) or key not in known:
                self.fail(path, f"source {key!r} is not listed in 'sources'; {closest(str(key), known)}")
            self.used.add(key)

    def sequence(self, path: Keys, unit: str) -> FloatArray:
        """The numbers of a sourced list of any length but 0."""
        value = self.sourced(path, unit)
        if not isinstance(value, (list, tuple)) or not value:
            self.fail((*path, "value"), f"expected a list of numbers, got {value!r}")
        return self.numbers((*path, "value"), value, ((len(value),),))

    def numbers(self, path: Keys, value: Any, shapes: tuple[tuple[int, ...], ...]) -> FloatArray:
        """`value` as an array of finite numbers with one of `shapes`."""
        try:
            array = np.array(value, dtype=np.float64)
        except (TypeError, ValueError):
            self.fail(path, f"{value!r} is not a number or a regular list of numbers")
        if isinstance(value, (str, bool)) or (array.shape not in shapes):
            wanted = " or ".join("x".join(map(str, shape)) or "one number" for shape in shapes)
            self.fail(path, f"{value!r} has the wrong shape: expected {wanted}")
        if not np.all(np.isfinite(array)):
            self.fail(path, f"{value!r} holds a number that is not finite")
        return array


def read(source: str | Path | Mapping[str, Any]) -> Document:
    """A document from a mapping, the path of a YAML file, or the name of a known sheet."""
    document = _read(source)
    document.data = _without_nulls(document.data)
    return document


def _without_nulls(node: Mapping[str, Any]) -> dict[str, Any]:
    """The mapping without keys that are null, which is how a sheet drops a key of the one it inherits from."""
    return {
        key: _without_nulls(value) if isinstance(value, Mapping) else value
        for key, value in node.items()
        if value is not None
    }


def _read(source: str | Path | Mapping[str, Any]) -> Document:
    if isinstance(source, Mapping):
        return Document(dict(source), label=f"vehicle {source.get('name') or ''}".strip())
    path = Path(source)
    if path.suffix in (".yaml", ".yml"):
        if not path.is_file():
            raise VehicleError(
                f"vehicle sheet {str(source)!r} does not exist; {closest(path.stem, sheet_names())}"
            )
        return _compose(path.read_text(encoding="utf-8"), str(path), path.parent)
    return _named(str(source), None)


def _named(name: str, folder: Path | None) -> Document:
    """The sheet `name`, from `folder` if it lies there."""
    if folder is not None and (folder / f"{name}.yaml").is_file():
        path = folder / f"{name}.yaml"
        return _compose(path.read_text(encoding="utf-8"), str(path), folder)
    known = sheets()
    if name not in known:
        raise VehicleError(f"vehicle {name!r} is not known; {closest(name, known)}")
    return _compose(known[name].read_text(encoding="utf-8"), f"conf/vehicle/{name}.yaml", None)


def _compose(text: str, label: str, folder: Path | None) -> Document:
    """Parse YAML and merge it over the sheets that its `defaults` name, as Hydra does."""
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f" line {mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or "unreadable"
        raise VehicleError(f"{label}{line}: not valid YAML: {problem}") from None
    document = Document({}, label=label)
    if not isinstance(node, yaml.MappingNode):
        raise VehicleError(f"{label}: a vehicle sheet is a mapping of keys")
    data = _construct(node, document, (), label)
    parents = data.pop("defaults", [])
    merged: dict[str, Any] = {}
    places: dict[Keys, str] = {}
    for parent in parents if isinstance(parents, list) else [parents]:
        if parent != "_self_":
            base = _named(str(parent), folder)
            merged = _merge(merged, base.data)
            places.update(base.places)
    document.data = _merge(merged, data)
    document.places = places | document.places
    return document


def _construct(node: yaml.Node, document: Document, path: Keys, label: str) -> Any:
    document.places.setdefault(path, f"{label} line {node.start_mark.line + 1}")
    if isinstance(node, yaml.MappingNode):
        result: dict[Any, Any] = {}
        for key_node, value_node in node.value:
            key = key_node.value
            place = f"{label} line {key_node.start_mark.line + 1}"
            if key in result:
                raise VehicleError(f"{place}: key {key!r} is given twice")
            document.places[(*path, key)] = place
            result[key] = _construct(value_node, document, (*path, key), label)
        return result
    constructor = yaml.SafeLoader("")
    return constructor.construct_object(node, deep=True)


def _merge(base: dict[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in over.items():
        if isinstance(value, Mapping) and isinstance(merged.get(key), Mapping):
            merged[key] = _merge(merged[key], value)
        else:
            merged[key] = value
    return merged
