"""Read untrusted files: bytes, JSON and YAML, with limits that are checked before a document is built.

Only a regular file of limited size is read: never a silent pipe or an endless device. PyYAML's loaders
compose recursively, so 100,000 brackets or dashes would crash the process. With aliases, a document of some
hundred bytes can expand to billions of values. So the parser's events, which arrive one by one, are counted
before the document is built.
"""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import re
import stat
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    import yaml

DOCUMENT = 16 * 1024**2
"""largest size of a manifest, configuration or sheet in bytes; files of auvbench have about ten thousand bytes"""
DATA = 256 * 1024**2
"""largest unpacked size of a table or of trajectories in bytes; a million training episodes have 200 million bytes"""
WEIGHTS = 2 * 1024**3
"""largest size of a policy or checkpoint file in bytes"""

DEPTH = 100
"""largest number of levels of nesting; a run's configuration has six"""
WHOLE = 2**64
"""largest whole number; no counter reaches it"""
DIGITS = 1000
"""largest number of digits of a whole number; Python rejects numbers of 4301 digits"""
VALUES = 1_000_000
"""largest number of values of a YAML document; each alias counts as a repetition of all values"""

TOO_DEEP = f"it is nested more than {DEPTH} levels deep"


def content(path: Path | str, limit: int = DOCUMENT) -> bytes:
    """Return all bytes of a regular file.

    Raises:
        OSError: the file is missing or cannot be read.
        ValueError: the path is not a regular file, or the file is longer than `limit`.
    """
    # Without O_NONBLOCK, opening a pipe would wait for a writer.
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode):
        os.close(descriptor)
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        raise ValueError("it is a pipe, a socket or a device, not a file")
    with open(descriptor, "rb") as file:
        data = file.read() if status.st_size <= limit else b""
    if len(data) > limit or status.st_size > limit:
        size = f"{limit // 1024**2} MiB" if limit >= 1024**2 else f"{limit} bytes"
        raise ValueError(f"it has more than {size}, the largest size that auvbench reads")
    return data


def json_value(data: bytes | str, *, whole: int = WHOLE) -> Any:
    """Return a JSON value of limited depth, without NaN, infinities and impossibly large numbers.

    Args:
        data: JSON text.
        whole: largest valid whole number; the state of a random generator needs 128 bits.

    Raises:
        ValueError: the text is not valid; the message says why in one line.
    """
    try:
        value = json.loads(data, parse_constant=_no_constant)
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    level: list[Any] = [value]
    for _ in range(DEPTH):
        following: list[Any] = []
        for node in level:
            if isinstance(node, dict):
                following += node.values()
            elif isinstance(node, list):
                following += node
            elif isinstance(node, float) and not math.isfinite(node):
                raise ValueError("a number in it is too large")
            elif isinstance(node, int) and abs(node) > whole:
                raise ValueError("a whole number in it is too large")
        if not following:
            return value
        level = following
    raise ValueError(TOO_DEEP)


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not JSON")


def yaml_value(data: bytes) -> Any:
    """Return a YAML value of limited depth and size, read as Hydra reads it: `1e-3` is a number, a date is a
    text.

    Raises:
        ValueError: the text is not valid; the message says why in one line.
    """
    import yaml

    try:
        check_yaml(data)
        return yaml.load(data, Loader=_reader())
    except yaml.YAMLError as error:
        raise ValueError(no_yaml(error)) from error


def check_yaml(data: bytes) -> None:
    """Reject YAML with too deep nesting, too many values from aliases, a tag (type of a value), or a key that is not a text.

    Invalid YAML passes this check: the loader rejects it later and names the position.

    Raises:
        ValueError: the text was rejected; the message is one line.
    """
    import yaml

    with contextlib.suppress(yaml.YAMLError):
        _check_events(data)


def _check_events(data: bytes) -> None:
    import yaml

    depth = anchored = events = aliases = 0  # anchored: depth of the outermost open collection with an anchor
    resolver = yaml.resolver.Resolver()
    parts: list[int | None] = [None]  # number of keys and values of each open collection; None for a list
    for event in yaml.parse(data, Loader=_loader()):
        events += 1
        if isinstance(event, yaml.NodeEvent) and parts[-1] is not None:
            if parts[-1] % 2 == 0 and isinstance(event, yaml.ScalarEvent):
                _check_key(event, resolver)
            parts[-1] += 1
        if isinstance(event, yaml.CollectionStartEvent):
            parts.append(0 if isinstance(event, yaml.MappingStartEvent) else None)
        elif isinstance(event, yaml.CollectionEndEvent):
            parts.pop()
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > DEPTH:
                raise ValueError(TOO_DEEP)
            if event.anchor is not None and not anchored:
                anchored = depth
        elif isinstance(event, yaml.CollectionEndEvent):
            if depth == anchored:
                anchored = 0
            depth -= 1
        elif isinstance(event, yaml.AliasEvent):
            aliases += 1
            if anchored:
                raise ValueError(
                    f"*{event.anchor} is inside an element that has an anchor itself; replace it by the values that it stands for"
                )
        text = event.value if isinstance(event, yaml.ScalarEvent) and not event.style else ""
        if len(text) > DIGITS and text.lstrip("+-").replace("_", "").isdecimal():
            raise ValueError(f"a number in it has more than {DIGITS} digits")
        # The loader fails on some tags with its own errors, for example on `!!bool maybe`.
        if (tag := getattr(event, "tag", None)) is not None:
            raise ValueError(f"{tag} is a tag, which names a type; only plain values are allowed; remove it")
    if events * (aliases + 1) > VALUES:
        raise ValueError(f"its aliases stand for more than {VALUES:,} values")


def _check_key(event: yaml.ScalarEvent, resolver: Any) -> None:
    """Reject a key that YAML does not read as text: YAML reads `on` and `yes` as the same key, true."""
    import yaml

    tag = resolver.resolve(yaml.ScalarNode, event.value, event.implicit)
    if tag in (f"tag:yaml.org,2002:{kind}" for kind in ("bool", "null", "int", "float", "timestamp")):
        kind = tag.rpartition(":")[2]
        raise ValueError(
            f"line {mark.line + 1 if (mark := event.start_mark) else 0}: the key {event.value or '~'} is read as {_KINDS[kind]}, not as a text; write "
            f'"{event.value or "~"}" in quotes'
        )


_KINDS = {
    "bool": "a truth value",
    "null": "null",
    "int": "a number",
    "float": "a number",
    "timestamp": "a date",
}


def no_yaml(error: yaml.YAMLError) -> str:
    """Return the error of the YAML parser in one line."""
    mark = getattr(error, "problem_mark", None)
    line = f"line {mark.line + 1}: " if mark is not None else ""
    return f"{line}{getattr(error, 'problem', None) or 'not valid YAML'}"


@cache
def _reader() -> Any:
    """Return a YAML loader that reads values as OmegaConf's loader does and rejects duplicate keys.

    OmegaConf itself is not imported.
    """
    import yaml

    class Reader(_loader()):  # type: ignore[misc]
        def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
            keys: set[str] = set()
            for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
                if key.value in keys:
                    why = f"found duplicate key {key.value}"
                    raise yaml.constructor.ConstructorError(None, None, why, key.start_mark)
                keys.add(key.value)
            return dict(super().construct_mapping(node, deep))

    number, date = "tag:yaml.org,2002:float", "tag:yaml.org,2002:timestamp"
    Reader.add_implicit_resolver(number, _FLOAT, list("-+0123456789."))
    Reader.yaml_implicit_resolvers = {
        first: [(tag, pattern) for tag, pattern in resolvers if tag != date]
        for first, resolvers in Reader.yaml_implicit_resolvers.items()
    }
    return Reader


_FLOAT = re.compile(
    r"""^(?:
     [-+]?[0-9]+(?:_[0-9]+)*\.[0-9_]*(?:[eE][-+]?[0-9]+)?
    |[-+]?[0-9]+(?:_[0-9]+)*(?:[eE][-+]?[0-9]+)
    |\.[0-9]+(?:_[0-9]+)*(?:[eE][-+][0-9]+)?
    |[-+]?[0-9]+(?:_[0-9]+)*(?::[0-5]?[0-9])+\.[0-9_]*
    |[-+]?\.(?:inf|Inf|INF)
    |\.(?:nan|NaN|NAN))$""",
    re.X,
)
"""numbers with a point or an exponent, as in omegaconf 2.3"""


def _loader() -> Any:
    import yaml

    return getattr(yaml, "CSafeLoader", yaml.SafeLoader)
