"""Finding and reading vehicle sheets: names, files, YAML with line numbers, and what a sheet inherits."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import yaml

from auvbench.config import plugins
from auvbench.errors import VehicleError, closest
from auvbench.untrusted import documents, reading
from auvbench.untrusted.path_safety import is_plain
from auvbench.vehicles.document import Document, Keys


def sheets() -> dict[str, Traversable]:
    """Vehicle sheets by name: of auvbench, of installed packages, and in `conf/vehicle` of the working directory.

    The latter win, as they do in Hydra's search path.
    """
    found: dict[str, Traversable] = {}
    for folder in plugins.option_folders("vehicle"):
        if folder.is_dir():
            for entry in folder.iterdir():
                if entry.name.endswith(".yaml"):
                    found[entry.name.removesuffix(".yaml")] = entry
    return dict(sorted(found.items()))


def sheet_names() -> list[str]:
    """Names of the vehicle sheets that can be loaded by name."""
    return list(sheets())


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
        name = str(source.get("name") or "")
        return Document(dict(source), label=f"vehicle {name}".strip(), origin=lambda: _origin(name))
    path = Path(source)
    if path.suffix in (".yaml", ".yml"):
        if not path.exists():
            raise VehicleError(
                f"vehicle sheet {str(source)!r} does not exist; {closest(path.stem, sheet_names())}"
            )
        return _compose(path, str(path), path.parent)
    name = str(source)
    known = sheets()
    if name not in known:
        raise VehicleError(f"vehicle {name!r} is not known; {closest(name, known)}")
    return _compose(known[name], f"conf/vehicle/{name}.yaml", None)


def _origin(name: str) -> Document | None:
    """The sheet that a composed mapping called `name` comes from, for the lines of messages about it."""
    try:
        return _read(name) if name in sheets() else None
    except VehicleError:  # changed since: the message does without a line
        return None


def _compose(entry: Traversable, label: str, folder: Path | None, heirs: tuple[str, ...] = ()) -> Document:
    """Parse a sheet and merge it over those that its `defaults` name, as Hydra does.

    Args:
        entry: the file.
        label: what messages call it.
        folder: where its parents are looked for first.
        heirs: labels of the sheets that inherit from this one, which therefore cannot be its parents.
    """
    document = _parse(_text(entry, label), label)
    parents = document.data.pop("defaults", [])
    merged: dict[str, Any] = {}
    places: dict[Keys, str] = {}
    for parent in parents if isinstance(parents, list) else [parents]:
        if parent != "_self_":
            base = _parent(str(parent), folder, document, (*heirs, label))
            merged = _merge(merged, base.data)
            places.update(base.places)
    document.data = _merge(merged, document.data)
    document.places = places | document.places
    return document


def _parent(name: str, folder: Path | None, heir: Document, heirs: tuple[str, ...]) -> Document:
    """The sheet `name` that `heir` inherits from, out of `folder` if it lies there."""
    if folder is not None and is_plain(name) and (folder / f"{name}.yaml").is_file():
        entry: Traversable = folder / f"{name}.yaml"
        label = str(entry)
    else:
        folder, known = None, sheets()
        if name not in known:
            heir.fail(("defaults",), f"vehicle {name!r} is not known; {closest(name, known)}")
        entry, label = known[name], f"conf/vehicle/{name}.yaml"
    if label in heirs:
        loop = " -> ".join((*heirs[heirs.index(label) :], label))
        heir.fail(("defaults",), f"{name!r} inherits from itself ({loop}); name another sheet")
    return _compose(entry, label, folder, heirs)


def _text(entry: Traversable, label: str) -> str:
    try:
        data = reading.content(entry) if isinstance(entry, Path) else entry.read_bytes()
        documents.check_yaml(data)
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        byte = error.object[error.start]
        raise VehicleError(
            f"{label} line {line}: byte 0x{byte:02x} is not UTF-8: save the sheet as UTF-8 text"
        ) from None
    except OSError as error:
        raise VehicleError(f"{label}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise VehicleError(f"{label}: not valid YAML: {error}") from None


def _parse(text: str, label: str) -> Document:
    document = Document({}, label=label)
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        if not isinstance(node, yaml.MappingNode):
            raise VehicleError(f"{label}: a vehicle sheet is a mapping of keys")
        document.data = _construct(node, document, (), label)
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise VehicleError(
            f"{label} line {line}: not valid YAML: character {error.character!r} is not allowed"
        ) from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f" line {mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or "unreadable"
        raise VehicleError(f"{label}{place}: not valid YAML: {problem}") from None
    return document


def _construct(node: yaml.Node, document: Document, path: Keys, label: str) -> Any:
    document.places.setdefault(path, f"{label} line {node.start_mark.line + 1}")
    if isinstance(node, yaml.MappingNode):
        result: dict[Any, Any] = {}
        for key_node, value_node in node.value:
            key = key_node.value
            place = f"{label} line {key_node.start_mark.line + 1}"
            if not isinstance(key, str):
                raise VehicleError(f"{place}: a key is a word, not a list or a mapping")
            if key in result:
                raise VehicleError(f"{place}: key {key!r} is given twice")
            document.places[(*path, key)] = place
            result[key] = _construct(value_node, document, (*path, key), label)
        return result
    constructor = yaml.SafeLoader("")
    try:
        return constructor.construct_object(node, deep=True)
    except ValueError as error:  # 2024-13-45 looks like a date and is none
        raise VehicleError(f"{label} line {node.start_mark.line + 1}: {node.value!r}: {error}") from None


def _merge(base: dict[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in over.items():
        if isinstance(value, Mapping) and isinstance(merged.get(key), Mapping):
            merged[key] = _merge(merged[key], value)
        else:
            merged[key] = value
    return merged
