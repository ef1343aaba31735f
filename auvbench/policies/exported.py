"""Read a policy from a file: an ONNX network and, next to it, a card in JSON that describes the network's inputs and outputs.

Reading needs only NumPy and ONNX Runtime: no torch, no Stable-Baselines3, no compiled code. The network takes
raw observations (n, n_obs) in the units of the environment and returns actions (n, n_u) in [-1, 1]; scaling
and clipping are in the file.

ONNX Runtime reads and runs the file in a separate process, which cannot open files and has limits of memory
and time (`auvbench/untrusted/sandbox.py`). Therefore a file may contain any operators: a file that crashes,
never ends or takes all memory gives a one-line error. The network's answers are checked: they must have the right
shape, be the same for the same observation, and be valid actions.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import MissingExtraError, RunError
from auvbench.untrusted import reading, sandbox, typed_json
from auvbench.untrusted.text import plain, short

FORMAT = "auvbench-policy"
SCHEMA_VERSION = 1
"""schema version of the card"""

LARGEST, LARGEST_CARD = 16 << 20, 1 << 20
"""Largest size of a network and of a card, bytes"""

MOST = 1000
"""Largest number of observed numbers or actuators in a card, and of observations that a network may require at once"""

Floats = NDArray[np.float32]

NETWORK, CARD = "policy.onnx", "policy.json"
"""Names of the network and the card in the folder `model/` of a run of `algo=onnx`"""

SLACK = 1e-6
"""Largest amount by which an action may exceed [-1, 1], for rounding errors; such an action is clipped"""

ROWS = 64
"""Number of rows of each forward pass. It is fixed, because matrix products of another shape may round differently, and
an action must not depend on the number of observations that are passed together
"""


DIFFERENT = "answers the same observations differently the second time; its actions must depend on the observation only"

Lengths = tuple[int | None, ...]
"""lengths of an array's axes; None for an axis of any length"""


@dataclass(frozen=True, slots=True)
class Port:
    """Input or output of a network."""

    name: str
    type: str  # float32, float64, or another name from ONNX Runtime
    shape: Lengths

    def __str__(self) -> str:
        lengths = ", ".join("n" if length is None else str(length) for length in self.shape)
        return f"{short(self.name, 60)!r} ({lengths}) {short(self.type, 40)}"


class PolicyError(RunError):
    """A policy's file or card cannot be used, or the policy returned an invalid action."""


@dataclass(frozen=True, slots=True)
class Named:
    """Entry of a card with a name: a vehicle, an observed number or an actuator."""

    name: str


@dataclass(frozen=True, slots=True)
class _File:
    sha256: str


@dataclass(frozen=True, slots=True)
class _Task:
    position_frame: Literal["world", "body"]
    """coordinate frame in which the policy observes the position error"""


@dataclass(frozen=True, slots=True, eq=False)
class Card:
    """Entries of a card that auvbench reads."""

    name: str
    vehicle: Named
    frequency_hz: Annotated[float, typed_json.Range(1e-3, 1000)]
    task: _Task
    observation: tuple[Named, ...]
    action: tuple[Named, ...]
    file: _File
    document: dict[str, Any] = field(default_factory=dict)
    """The whole card, including the entries that auvbench does not read"""

    @property
    def observed(self) -> tuple[str, ...]:
        """Return the names of the observed numbers, in order."""
        return tuple(item.name for item in self.observation)

    @property
    def actuators(self) -> tuple[str, ...]:
        """Return the names of the actuators, in order."""
        return tuple(item.name for item in self.action)


def card_path(path: Path | str) -> Path:
    """Return the path of an ONNX file's card, which has the same stem.

    >>> card_path("policies/ppo.onnx").name
    'ppo.json'
    """
    return Path(path).with_suffix(".json")


def read_card(path: Path | str) -> Card:
    """Read a card without its network.

    Raises:
        PolicyError: the file is missing, or not a card.
    """
    card = parse_card(content(Path(path), LARGEST_CARD), str(path))
    if card is None:
        raise PolicyError(f'{path}: is not the card of a policy ("format" is not "{FORMAT}")')
    return card


def parse_card(data: bytes, where: str) -> Card | None:
    """Return the card in `data`; None if the JSON describes something else.

    Raises:
        PolicyError: the data are not JSON or have another schema version, or an entry is missing or invalid.
    """
    try:
        document = reading.json_value(data)
    except ValueError as error:
        raise PolicyError(f"{where}: is not JSON: {short(error)}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        return None
    version = document.get("schema_version")
    if version != SCHEMA_VERSION:
        raise PolicyError(
            f"{where}: schema_version {short(version, 40)}, but this auvbench reads {SCHEMA_VERSION}; export the policy again"
        )
    try:
        card = replace(typed_json.convert(document, Card), document=document)
    except ValueError as error:
        raise PolicyError(f"{where}: {error}") from error
    for key, items in (("observation", card.observation), ("action", card.action)):
        if not 0 < len(items) <= MOST:
            raise PolicyError(f"{where}: {key} has {len(items)} entries, must have 1 to {MOST}")
    return card


def content(path: Path, limit: int) -> bytes:
    """Return a file's bytes.

    Raises:
        PolicyError: the file cannot be read, or has more than `limit` bytes.
    """
    try:
        return reading.content(path, limit)
    except FileNotFoundError as error:
        raise PolicyError(f"{path}: no such file") from error
    except (OSError, ValueError) as error:
        raise PolicyError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error


class Policy:
    """Network of an ONNX file, loaded in a separate process, that computes actions.

    Args:
        data: content of the ONNX file.
        where: name of the file, for messages.
        observations: length of an observation; None allows any length.
        actions: number of actuators; None allows any number.
        card: card of the file. It must name each number of an observation and each actuator.
        rows: number of rows of each forward pass (see `ROWS`), unless the file fixes this number; 1 is fastest for one
            observation.
        seconds: largest processor time for loading the file, and for each later answer, s.

    Raises:
        PolicyError: the file is damaged, has the wrong shape, or its answers depend on more than the
            observation.
        MissingExtraError: ONNX Runtime is not installed.
    """

    def __init__(
        self,
        data: bytes,
        where: str,
        *,
        observations: int | None = None,
        actions: int | None = None,
        card: Card | None = None,
        rows: int = ROWS,
        seconds: int = sandbox.SECONDS,
    ) -> None:
        if not installed("onnxruntime"):
            raise MissingExtraError("onnxruntime", extra="onnx", purpose="policies as ONNX files")
        self.where = where
        self.card = card
        self.sha256 = hashlib.sha256(data).hexdigest()
        self.seconds = 0.0
        """Processor time in s that the policy's process has used for all answers so far"""
        self.input, self.output = self._opened(data, seconds)
        try:
            _fits("input", self.input, observations, card.observed if card else None)
            _fits("output", self.output, actions, card.actuators if card else None)
            fixed, width = self.input.shape
            width = width or observations or (len(card.observation) if card else None)
            if width is None:
                raise ValueError(
                    f"its input {self.input} leaves the length of an observation open; export it with a fixed length"
                )
            self._rows = fixed or rows
            tried = np.random.default_rng(0).normal(size=(self._rows, width)).astype(self.input.type)
            first, second = self._query(tried), self._query(tried)
            answer = replace(self.output, shape=(None, *first.shape[1:]))
            _fits("output", answer, actions, card.actuators if card else None)
            if not np.array_equal(first, second, equal_nan=True):
                raise ValueError(DIFFERENT)
        except ValueError as error:
            raise PolicyError(f"{where}: {error}") from error
        self.n_observations, self.n_actions = width, first.shape[1]

    def _opened(self, data: bytes, seconds: int) -> tuple[Port, Port]:
        """Start the process of the policy; return the network's input and output."""
        try:
            self._child = sandbox.Child(sandbox.POLICY, data, seconds=seconds)
            ports, _ = self._child.answer()
        except ValueError as error:
            raise PolicyError(
                f"{self.where}: is not an ONNX file that ONNX Runtime can load: {_reason(error)}"
            ) from error
        try:
            return (
                _only(_ports(ports.get("inputs")), "input", "observation (n, length)"),
                _only(_ports(ports.get("outputs")), "output", "action (n, actuators)"),
            )
        except ValueError as error:
            raise PolicyError(f"{self.where}: {error}") from error

    def act(self, observation: NDArray[np.floating]) -> Floats:
        """Return actions (n, n_u) in [-1, 1] for raw observations (n, n_obs) in the units of the environment.

        Raises:
            PolicyError: the answer has a NaN, an infinity, an action out of range, or the wrong shape, or the
                policy's process has ended.
        """
        rows = np.ascontiguousarray(observation, dtype=self.input.type)
        if rows.ndim != 2:
            raise PolicyError(f"{self.where}: was given observations of shape {rows.shape}, not (n, length)")
        if not len(rows):
            return np.zeros((0, self.n_actions), dtype=np.float32)
        try:
            action = self._query(rows)
        except ValueError as error:
            raise PolicyError(f"{self.where}: {error}") from error
        if action.shape != (len(rows), self.n_actions):
            raise PolicyError(
                f"{self.where}: answers {len(rows)} observations with an array of shape {action.shape}; must be one row of actions for each"
            )
        self._refuse(rows, action)
        return np.clip(action, -1.0, 1.0)

    def _query(self, rows: NDArray[np.floating]) -> Floats:
        """Return the unchecked answer (n, ...) to observations (n, n_obs).

        Raises:
            ValueError: the policy's process gives no answer, or an answer with a wrong type or number of rows.
        """
        try:
            note, arrays = self._child.ask({"rows": self._rows}, {"data": rows})
        except ValueError as error:
            raise ValueError(f"cannot be computed: {_reason(error)}") from error
        action, seconds = arrays.get("action"), note.get("seconds")
        if action is None or action.dtype != np.float32 or len(action.shape) != 2 or len(action) != len(rows):
            raise ValueError(f"answers {len(rows)} observations with {_described(action)}")
        self.seconds += seconds if isinstance(seconds, float) and seconds > 0.0 else 0.0
        return action

    def _refuse(self, observation: NDArray[Any], action: Floats) -> None:
        # NaN compares as False.
        fine = np.abs(action) <= 1.0 + SLACK
        if fine.all():
            return
        row, column = (int(i) for i in np.argwhere(~fine)[0])
        numbers = ", ".join(f"{value:.4g}" for value in observation[row])
        raise PolicyError(
            f"{self.where}: answers {action[row, column]:g} (action {column}) to the observation ({numbers}): "
            "an action must be a "
            "finite number in [-1, 1]; scale or clip inside the file"
        )


def load(
    path: Path | str,
    *,
    observations: int | None = None,
    actions: int | None = None,
    rows: int = ROWS,
    seconds: int = sandbox.SECONDS,
) -> Policy:
    """Read an ONNX file and its card, if a card is next to it; see `Policy` for arguments and errors."""
    data, card, _ = read(path)
    sizes = {"observations": observations, "actions": actions}
    return Policy(data, str(path), card=card, rows=rows, seconds=seconds, **sizes)


def read(path: Path | str) -> tuple[bytes, Card | None, bytes | None]:
    """Return an ONNX file's bytes, its card, and the card's bytes. Without a card, the last two are None.

    Raises:
        PolicyError: a file cannot be read, or the card belongs to another file.
    """
    path = Path(path)
    if path.suffix == ".json" or path.is_dir():
        what = "is a folder" if path.is_dir() else "is a card"
        raise PolicyError(f"{path}: {what}; name the ONNX file")
    data = content(path, LARGEST)
    card_file = card_path(path)
    if not os.path.lexists(card_file):
        return data, None, None
    text = content(card_file, LARGEST_CARD)
    card = parse_card(text, str(card_file))
    if card is None:
        return data, None, None
    if card.file.sha256 != hashlib.sha256(data).hexdigest():
        raise PolicyError(
            f"{card_file}: belongs to another file than {path.name} (its sha256 differs); "
            "export again, or remove the card"
        )
    return data, card, text


def installed(package: str) -> bool:
    """Return whether a package can be imported, without importing it."""
    return importlib.util.find_spec(package) is not None


def _ports(answer: object) -> tuple[Port, ...]:
    """Return the inputs or outputs that the policy's process reports.

    Raises:
        ValueError: the answer is not a list of inputs or outputs.
    """
    ports = []
    for name, kind, shape in typed_json.convert(answer, list[list[Any]]):
        lengths = tuple(
            n if isinstance(n, int) and n > 0 else None for n in typed_json.convert(shape, list[Any])
        )
        text = str(kind).removeprefix("tensor(").removesuffix(")")
        ports.append(Port(str(name), {"float": "float32", "double": "float64"}.get(text, text), lengths))
    return tuple(ports)


def _only(ports: tuple[Port, ...], kind: str, what: str) -> Port:
    if len(ports) != 1:
        listed = ", ".join(map(str, ports[:6])) or "none"
        raise ValueError(f"has {len(ports)} {kind}s ({listed}); a policy must have one, the {what}")
    return ports[0]


def _fits(kind: str, port: Port, length: int | None, named: tuple[str, ...] | None) -> None:
    """Check that a port has float numbers of shape (n, length), and one column for each name of the card.

    Raises:
        ValueError: the port has another type or shape.
    """
    label, shape = f"its {kind} {port}", port.shape
    if port.type not in ("float32", "float64"):
        raise ValueError(f"{label} must be float32 or float64")
    if len(shape) != 2:
        raise ValueError(f"{label} must have two dimensions, (n, {length or 'length'})")
    if (shape[0] or 0) > MOST:
        raise ValueError(f"{label} must take any number of observations at once, or at most {MOST}")
    if length is not None and shape[1] not in (None, length):
        raise ValueError(f"{label} must be (n, {length}) for this vehicle and task")
    if named is not None and shape[1] not in (None, len(named)):
        raise ValueError(f"{label} must have the {len(named)} entries that its card names")


def _described(answer: NDArray[Any] | None) -> str:
    return "nothing" if answer is None else f"an array of shape {answer.shape}"


def _reason(error: BaseException) -> str:
    text = plain(" ".join(str(error).split())) or type(error).__name__
    hint = (
        " (its weights are in another file, which auvbench does not read: export one file)"
        if "External data" in text
        else ""
    )
    return short(text.removeprefix("[ONNXRuntimeError] : "), 300) + hint
