"""Finding and reading vehicle sheets: names, files, and what a sheet inherits."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import yaml

from auvbench.config import plugins
from auvbench.errors import VehicleError, closest
from auvbench.untrusted import reading
from auvbench.vehicles.document import Document


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
        return Document(dict(source), f"vehicle {source.get('name') or ''}".strip())
    path = Path(source)
    if path.suffix in (".yaml", ".yml"):
        if not path.exists():
            raise VehicleError(
                f"vehicle sheet {str(source)!r} does not exist; {closest(path.stem, sheet_names())}"
            )
        return _compose(path, str(path))
    name = str(source)
    known = sheets()
    if name not in known:
        raise VehicleError(f"vehicle {name!r} is not known; {closest(name, known)}")
    return _compose(known[name], f"conf/vehicle/{name}.yaml")


def _compose(entry: Traversable, label: str, heirs: tuple[str, ...] = ()) -> Document:
    """Parse a sheet and merge it over those that its `defaults` name, as Hydra does.

    Args:
        entry: the file.
        label: what messages call it.
        heirs: labels of the sheets that inherit from this one, which therefore cannot be its parents.
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
    """The sheet `name` that `heir` inherits from."""
    known = sheets()
    if name not in known:
        heir.fail(("defaults",), f"vehicle {name!r} is not known; {closest(name, known)}")
    label = f"conf/vehicle/{name}.yaml"
    if label in heirs:
        loop = " -> ".join((*heirs[heirs.index(label) :], label))
        heir.fail(("defaults",), f"{name!r} inherits from itself ({loop}); name another sheet")
    return _compose(known[name], label, heirs)


class _Loader(yaml.SafeLoader):
    """Refuse a key that is given twice, as Hydra does; a pilot reads sheets without it."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                why = f"found duplicate key {key.value}"
                raise yaml.constructor.ConstructorError(None, None, why, key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def _parse(entry: Traversable, label: str) -> dict[str, Any]:
    """Return the content of a file."""
    try:
        data = reading.content(entry) if isinstance(entry, Path) else entry.read_bytes()
        reading.check_yaml(data)
        found = yaml.load(data.decode("utf-8"), Loader=_Loader)
    except UnicodeDecodeError:
        raise VehicleError(f"{label}: is no UTF-8: save the sheet as UTF-8 text") from None
    except OSError as error:
        raise VehicleError(f"{label}: cannot be read: {error.strerror}") from None
    except (ValueError, yaml.YAMLError) as error:
        reason = reading.no_yaml(error) if isinstance(error, yaml.YAMLError) else error
        raise VehicleError(f"{label}: not valid YAML: {reason}") from None
    if not isinstance(found, dict):
        raise VehicleError(f"{label}: a vehicle sheet is a mapping of keys")
    return found


def _merge(base: dict[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in over.items():
        if isinstance(value, Mapping) and isinstance(merged.get(key), Mapping):
            merged[key] = _merge(merged[key], value)
        else:
            merged[key] = value
    return merged
