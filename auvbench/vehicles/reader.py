"""Find and read vehicle sheets: names, files, and inheritance.

A `Document` has a sheet's content. Its methods return quantities after checking their sources, and raise errors that name
the file, the key and the rule.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from auvbench.config import folders
from auvbench.errors import VehicleError, closest
from auvbench.untrusted import reading
from auvbench.untrusted.text import short

if TYPE_CHECKING:  # composing a configuration needs no NumPy
    import numpy as np
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

LARGEST = 1e15
"""Largest number in a sheet, in any unit; products of such numbers are still finite"""

Keys = tuple[str, ...]


def sheets() -> dict[str, Traversable]:
    """Return the vehicle sheets by name: auvbench's sheets, sheets of installed packages, and sheets in
    `conf/vehicle` of the working directory.

    The sheets in the working directory take precedence, as in Hydra's search path.
    """
    entries: dict[str, Traversable] = {}
    for folder in folders.of_group("vehicle"):
        if folder.is_dir():
            for entry in folder.iterdir():
                if entry.name.endswith(".yaml"):
                    entries[entry.name.removesuffix(".yaml")] = entry
    return dict(sorted(entries.items()))


def sheet_names() -> list[str]:
    """Return the names of the vehicle sheets that can be loaded by name."""
    return list(sheets())


def read(source: str | Path | Mapping[str, Any]) -> Document:
    """Return the document for a sheet's content as a mapping, the path of a YAML file, or the name of a known sheet."""
    document = _read(source)
    document.data = _without_nulls(document.data)
    return document


def _without_nulls(node: Mapping[str, Any]) -> dict[str, Any]:
    """Return the mapping without keys whose value is null; a sheet drops an inherited key by setting it to null."""
    return {
        key: _without_nulls(value) if isinstance(value, Mapping) else value
        for key, value in node.items()
        if value is not None
    }


def _read(source: str | Path | Mapping[str, Any]) -> Document:
    if isinstance(source, Mapping):
        return Document(dict(source), f"vehicle {source.get('name') or ''}".strip())
    path = Path(source)
    if path.suffix in (".yaml", ".yml"):
        if not path.exists():
            raise VehicleError(
                f"vehicle sheet {str(source)!r} does not exist; {closest(path.stem, sheet_names())}"
            )
        return _compose(path, str(path))
    name = str(source)
    known_sheets = sheets()
    if name not in known_sheets:
        raise VehicleError(f"vehicle {name!r} is not known; {closest(name, known_sheets)}")
    return _compose(known_sheets[name], f"conf/vehicle/{name}.yaml")


def _compose(entry: Traversable, label: str, heirs: tuple[str, ...] = ()) -> Document:
    """Parse a sheet and merge it over the sheets in its `defaults`, as Hydra does.

    Args:
        entry: file of the sheet.
        label: name of the file in messages.
        heirs: labels of the sheets that inherit from this sheet; no heir can be a parent of this sheet.
    """
    document = Document(_parse(entry, label), label)
    parents = document.data.pop("defaults", [])
    merged: dict[str, Any] = {}
    for parent in parents if isinstance(parents, list) else [parents]:
        if parent != "_self_":
            merged = _merge(merged, _parent(str(parent), document, (*heirs, label)).data)
    document.data = _merge(merged, document.data)
    return document


def _parent(name: str, heir: Document, heirs: tuple[str, ...]) -> Document:
    """Return the sheet `name`, from which `heir` inherits."""
    known_sheets = sheets()
    if name not in known_sheets:
        heir.fail(("defaults",), f"vehicle {name!r} is not known; {closest(name, known_sheets)}")
    label = f"conf/vehicle/{name}.yaml"
    if label in heirs:
        loop = " -> ".join((*heirs[heirs.index(label) :], label))
        heir.fail(("defaults",), f"{name!r} inherits from itself ({loop}); name another sheet")
    return _compose(known_sheets[name], label, heirs)


def _parse(entry: Traversable, label: str) -> dict[str, Any]:
    """Return the content of a file."""
    try:
        data = reading.content(entry) if isinstance(entry, Path) else entry.read_bytes()
        data.decode("utf-8")
        content = reading.yaml_value(data)
    except UnicodeDecodeError:
        raise VehicleError(f"{label}: is not UTF-8: save the sheet as UTF-8 text") from None
    except OSError as error:
        raise VehicleError(f"{label}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise VehicleError(f"{label}: not valid YAML: {error}") from None
    if not isinstance(content, dict):
        raise VehicleError(f"{label}: a vehicle sheet must be a mapping of keys")
    return content


def _merge(base: dict[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in over.items():
        if isinstance(value, Mapping) and isinstance(merged.get(key), Mapping):
            merged[key] = _merge(merged[key], value)
        else:
            merged[key] = value
    return merged


@dataclass(frozen=True, slots=True)
class Quantity:
    """One number, or list of numbers, of a sheet."""

    path: Keys
    value: Any
    """A number, a list, a mapping of names to vectors, or the kind of a curve"""
    unit: str
    range: Any
    """Lowest and highest value, each with the shape of `value`; None if the sheet has no range"""
    sources: tuple[str, ...]
    note: str


def quantities(node: Mapping[str, Any], path: Keys = ()) -> list[Quantity]:
    """Return all sourced numbers of a checked sheet's content, in the sheet's order."""
    if "source" in node:
        source = node["source"]
        return [
            Quantity(
                path,
                node.get("value", node.get("kind")),
                str(node.get("unit", "1")),
                node.get("range"),
                tuple(source) if isinstance(source, (list, tuple)) else (str(source),),
                str(node.get("note", "")),
            )
        ]
    below = [
        quantities(child, (*path, str(key))) for key, child in node.items() if isinstance(child, Mapping)
    ]
    return [quantity for group in below for quantity in group]


@dataclass
class Document:
    """The content of a sheet."""

    data: dict[str, Any]
    label: str
    """Name in messages: the sheet's file, or the vehicle of a composed configuration"""
    used: set[str] = field(default_factory=set)
    """Keys of the sources that are named by the quantities read so far"""

    def fail(self, path: Keys, rule: str) -> NoReturn:
        """Raise a `VehicleError` that names `path` and the rule."""
        raise VehicleError(": ".join([self.label, *([".".join(path)] if path else []), rule]))

    def section(self, path: Keys, required: Iterable[str], optional: Iterable[str] = ()) -> dict[str, Any]:
        """Return the mapping at `path`. It must have all `required` keys, may have `optional` keys, and must have no
        other key.
        """
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

    def texts(self, key: str) -> tuple[str, ...]:
        """Return the list of texts under a top-level key; empty without the key."""
        value = self.data.get(key, [])
        if not isinstance(value, list) or not all(isinstance(text, str) for text in value):
            self.fail((key,), f"expected a list of texts, got {value!r}")
        return tuple(value)

    def quantity(self, path: Keys, unit: str, shapes: tuple[tuple[int, ...], ...] = ((),)) -> FloatArray:
        """Return the array of a sourced quantity `{value, unit, source}` in `unit` with one of `shapes`.

        A quantity may have a `range`: the lowest and the highest value in the sources, or on a test bench.
        """
        value = self.numbers((*path, "value"), self.sourced(path, unit, "range"), shapes)
        if "range" in self.mapping(path):
            self._check_range((*path, "range"), value)
        return value

    def _check_range(self, path: Keys, value: FloatArray) -> None:
        """Raise VehicleError if a range does not contain the value."""
        low, high = self.numbers(path, self.get(path), ((2, *value.shape),))
        if (low > value).any() or (value > high).any():
            self.fail(
                path,
                f"{self.get(path)!r} does not contain the value {value.tolist()!r}; change the range as well, or "
                "remove it: range: null",
            )

    def number(self, path: Keys, unit: str, low: float = -math.inf, above: float = -math.inf) -> float:
        """Return a sourced number after checking that it is at least `low` and greater than `above`."""
        value = float(self.quantity(path, unit))
        if value < low:
            self.fail((*path, "value"), f"{value:g} {unit} is out of range: it must be at least {low:g}")
        if value <= above:
            self.fail(
                (*path, "value"), f"{value:g} {unit} is out of range: it must be greater than {above:g}"
            )
        return value

    def sourced(self, path: Keys, unit: str, *optional: str) -> Any:
        """Return the value of `{value, unit, source}` after checking unit and source; `optional` keys are allowed."""
        node = self.get(path)
        if not isinstance(node, Mapping):
            self.fail(path, f"expected value, unit and source, got {node!r}")
        if "source" not in node:
            self.fail(path, "key 'source' is missing: every number must name its source")
        self.section(path, ("value", "source"), ("unit", "note", *optional))
        if str(node.get("unit", "1")) != unit:
            self.fail(
                (*path, "unit"), f"{node.get('unit')!r} is not the unit of this quantity; must be {unit!r}"
            )
        self.source((*path, "source"))
        return node["value"]

    def source(self, path: Keys) -> None:
        """Check that every source named at `path` is listed in `sources`, and mark it as used."""
        named = self.get(path)
        listed = self.mapping(("sources",))
        for key in named if isinstance(named, (list, tuple)) else [named]:
            if not isinstance(key, str) or key not in listed:
                self.fail(path, f"source {key!r} is not listed in 'sources'; {closest(str(key), listed)}")
            self.used.add(key)

    def sequence(self, path: Keys, unit: str) -> FloatArray:
        """Return the numbers of a sourced list, which must not be empty."""
        value = self.sourced(path, unit)
        if not isinstance(value, (list, tuple)) or not value:
            self.fail((*path, "value"), f"expected a list of numbers, got {value!r}")
        return self.numbers((*path, "value"), value, ((len(value),),))

    def numbers(self, path: Keys, value: Any, shapes: tuple[tuple[int, ...], ...]) -> FloatArray:
        """Return `value` as an array of finite numbers with one of `shapes`."""
        import numpy as np

        try:
            if isinstance(value, str):  # NumPy would convert a text such as "1.5" to a number
                raise TypeError
            array = np.array(value, dtype=np.float64)
        except (TypeError, ValueError):
            self.fail(path, f"{value!r} is not a number or a regular list of numbers")
        if isinstance(value, bool) or (array.shape not in shapes):
            expected = " or ".join("x".join(map(str, shape)) or "one number" for shape in shapes)
            self.fail(path, f"{value!r} has the wrong shape: expected {expected}")
        if not np.all(np.isfinite(array)):
            self.fail(path, f"{value!r} contains a number that is not finite")
        if np.any(np.abs(array) > LARGEST):
            self.fail(
                path, f"{short(repr(value))} contains a number beyond ±{LARGEST:g}, the largest allowed"
            )
        return array
