"""A policy as a file: an ONNX network and, next to it, a card in JSON that says what its numbers mean.

Reading one needs NumPy, onnx and ONNX Runtime alone: no torch, no Stable-Baselines3, nothing that is compiled. The network
takes raw observations (n, n_obs) in the units of the environment and returns actions (n, n_u) in [-1, 1]; scaling and
clipping are in the file. Files and cards of other people are checked (`auvbench/untrusted/onnx_file.py`), and the runtime
gets only what was checked.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import MissingExtraError, RunError
from auvbench.untrusted import onnx_file, reading, typed_json
from auvbench.untrusted.onnx_file import Port
from auvbench.untrusted.text import plain, short

FORMAT = "auvbench-policy"
SCHEMA_VERSION = 1
"""of the card"""

LARGEST = 1 << 20
"""bytes of a card"""

MOST = 1000
"""observations or actions"""

Floats = NDArray[np.float32]

NETWORK, CARD = "policy.onnx", "policy.json"
"""The files of a run of `algo=onnx`, in its `model/`."""

SLACK = 1e-6
"""by which an action may leave [-1, 1], for rounding; it is clipped then"""

ROWS = 64
"""of each forward pass: matrix products of another shape may round differently, and an answer must not depend on how
many are asked for together"""


class PolicyError(RunError):
    """A policy's file or card cannot be used, or the policy answers what is no action."""


@dataclass(frozen=True, slots=True)
class Named:
    """A vehicle, an observed number or an actuator."""

    name: str


@dataclass(frozen=True, slots=True)
class _File:
    sha256: str


@dataclass(frozen=True, slots=True)
class _Task:
    position_frame: Literal["world", "body"]
    """of the position error that the policy observes"""


@dataclass(frozen=True, slots=True, eq=False)
class Card:
    """The entries of a card that are read."""

    name: str
    vehicle: Named
    frequency_hz: Annotated[float, typed_json.Range(1e-3, 1000)]
    task: _Task
    observation: tuple[Named, ...]
    action: tuple[Named, ...]
    file: _File
    document: dict[str, Any] = field(default_factory=dict)
    """the whole card"""

    @property
    def observed(self) -> tuple[str, ...]:
        """Names of the observed numbers, in their order."""
        return tuple(item.name for item in self.observation)

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the actuators, in their order."""
        return tuple(item.name for item in self.action)


def card_path(path: Path | str) -> Path:
    """Return where the card of an ONNX file lies: under the same stem.

    >>> card_path("policies/ppo.onnx").name
    'ppo.json'
    """
    return Path(path).with_suffix(".json")


def read_card(path: Path | str) -> Card:
    """Read a card by itself.

    Raises:
        PolicyError: it is missing, or no card.
    """
    card = parse_card(content(Path(path), LARGEST), str(path))
    if card is None:
        raise PolicyError(f'{path}: is no card of a policy ("format" is not "{FORMAT}")')
    return card


def parse_card(data: bytes, where: str) -> Card | None:
    """Return the card in some bytes; None if the JSON is of something else.

    Raises:
        PolicyError: it is no JSON, of another schema version, or an entry is missing or impossible.
    """
    try:
        document = reading.json_value(data)
    except ValueError as error:
        raise PolicyError(f"{where}: is no JSON: {short(error)}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        return None
    version = document.get("schema_version")
    if version != SCHEMA_VERSION:
        raise PolicyError(
            f"{where}: schema_version {short(version, 40)}, but this auvbench reads {SCHEMA_VERSION}"
        )
    try:
        found = replace(typed_json.convert(document, Card), document=document)
    except ValueError as error:
        raise PolicyError(f"{where}: {error}") from error
    for key, items in (("observation", found.observation), ("action", found.action)):
        if not 0 < len(items) <= MOST:
            raise PolicyError(f"{where}: {key} has {len(items)} entries, must have 1 to {MOST}")
    return found


def content(path: Path, limit: int) -> bytes:
    """Return a file's bytes, at most `limit` of them.

    Raises:
        PolicyError: it cannot be read.
    """
    try:
        return reading.content(path, limit)
    except FileNotFoundError as error:
        raise PolicyError(f"{path}: no such file") from error
    except (OSError, ValueError) as error:
        raise PolicyError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error


class Policy:
    """A network that is ready to act.

    Args:
        data: the ONNX file.
        where: its name, for messages.
        observations: length of an observation; None for any.
        actions: number of actuators; None for any.
        card: of the file; its names must be as many as inputs and outputs.
        rows: of each forward pass (see `ROWS`), unless the file fixes them; 1 acts fastest on one observation.

    Raises:
        PolicyError: the file is damaged, foreign, of another shape, or holds what is refused.
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
    ) -> None:
        self.where = where
        self.card = card
        self.sha256 = hashlib.sha256(data).hexdigest()
        try:
            self.file = file = onnx_file.parse(data)
            self._input = _only(file.inputs, "input", "observation (n, length)")
            self._output = _only(file.outputs, "output", "action (n, actuators)")
            _fits("input", self._input, observations, card.observed if card else None)
            fixed, width = self._input.shape or (None, None)
            width = width or observations or (len(card.observation) if card else None)
            if width is None:
                raise ValueError(f"its input {self._input} leaves the length of an observation open")
            self._rows = fixed or rows
            shape = file.answer(self._rows, width)
            if shape[:1] != (self._rows,):
                raise ValueError(f"it answers {self._rows} observations with an array of shape {shape}")
            answer = replace(self._output, shape=(None, *shape[1:]))
            _fits("output", answer, actions, card.actuators if card else None)
        except ValueError as error:
            raise PolicyError(f"{where}: {error}") from error
        self.n_observations, self.n_actions = width, shape[1] or 0
        self._session = _session(file.serialised(), where)

    def act(self, observation: NDArray[np.floating]) -> Floats:
        """Return actions (n, n_u) in [-1, 1] for raw observations (n, n_obs) in their units.

        Raises:
            PolicyError: it answers with a NaN, an infinity, an action out of range, or one of another shape.
        """
        given = np.ascontiguousarray(observation, dtype=self._input.type)
        if given.ndim != 2:
            raise PolicyError(f"{self.where}: was given observations of shape {given.shape}, not (n, length)")
        rows = self._rows
        parts = [self._pass(given[at : at + rows]) for at in range(0, len(given), rows)]
        action = np.concatenate(parts) if parts else np.zeros((0, self.n_actions), dtype=np.float32)
        self._refuse(given, action)
        return np.clip(action, -1.0, 1.0)

    def _pass(self, part: NDArray[Any]) -> Floats:
        rows = np.zeros((self._rows, part.shape[1]), dtype=part.dtype)
        rows[: len(part)] = part
        try:
            (answer,) = self._session.run([self._output.name], {self._input.name: rows})
        except Exception as error:  # the runtime raises of all kinds
            raise PolicyError(f"{self.where}: cannot be computed: {_reason(error)}") from error
        if np.shape(answer) != (len(rows), self.n_actions):
            raise PolicyError(
                f"{self.where}: answers {len(rows)} observations with an array of shape {np.shape(answer)}"
            )
        return np.asarray(answer[: len(part)], dtype=np.float32)

    def _refuse(self, observation: NDArray[Any], action: Floats) -> None:
        # NaN compares as False.
        fine = np.abs(action) <= 1.0 + SLACK
        if fine.all():
            return
        row, column = (int(i) for i in np.argwhere(~fine)[0])
        seen = ", ".join(f"{value:.4g}" for value in observation[row])
        raise PolicyError(
            f"{self.where}: answers {action[row, column]:g} (action {column}) to the observation ({seen}): an action is a "
            "finite number in [-1, 1]; scale or clip inside the file"
        )


def load(
    path: Path | str, *, observations: int | None = None, actions: int | None = None, rows: int = ROWS
) -> Policy:
    """Read an ONNX file and the card next to it, if there is one; arguments and errors are those of `Policy`."""
    data, card, _ = read(path)
    return Policy(data, str(path), observations=observations, actions=actions, card=card, rows=rows)


def read(path: Path | str) -> tuple[bytes, Card | None, bytes | None]:
    """Return an ONNX file's bytes, its card, and the card's bytes; None where no card lies next to it.

    Raises:
        PolicyError: one of them cannot be read, or the card is of another file.
    """
    path = Path(path)
    if path.suffix == ".json" or path.is_dir():
        what = "is a folder" if path.is_dir() else "is a card"
        raise PolicyError(f"{path}: {what}; name the ONNX file")
    data = content(path, onnx_file.LARGEST)
    card_file = card_path(path)
    if not os.path.lexists(card_file):
        return data, None, None
    text = content(card_file, LARGEST)
    card = parse_card(text, str(card_file))
    if card is None:
        return data, None, None
    if card.file.sha256 != hashlib.sha256(data).hexdigest():
        raise PolicyError(
            f"{card_file}: is the card of another file than {path.name} (its sha256 differs); "
            "export again, or remove the card"
        )
    return data, card, text


def _only(ports: tuple[Port, ...], kind: str, what: str) -> Port:
    if len(ports) != 1:
        listed = ", ".join(map(str, ports[:6])) or "none"
        raise ValueError(f"has {len(ports)} {kind}s ({listed}); a policy has one, the {what}")
    return ports[0]


def _fits(kind: str, port: Port, wanted: int | None, named: tuple[str, ...] | None) -> None:
    """
    Raises:
        ValueError: the port is not one of float numbers of shape (n, wanted).
    """
    told, shape = f"its {kind} {port}", port.shape or (None, None)
    if port.type not in ("float32", "float64"):
        raise ValueError(f"{told} must be float32 or float64")
    if len(shape) != 2:
        raise ValueError(f"{told} must have two dimensions, (n, {wanted or 'length'})")
    if (shape[0] or 0) > MOST:
        raise ValueError(f"{told} must take any number of observations at once, or at most {MOST}")
    if wanted is not None and shape[1] not in (None, wanted):
        raise ValueError(f"{told} must be (n, {wanted}) for this vehicle and task")
    if named is not None and shape[1] not in (None, len(named)):
        raise ValueError(f"{told} has not the {len(named)} entries that its card names")


def _session(data: bytes, where: str) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise MissingExtraError("onnxruntime", extra="onnx", purpose="policies as ONNX files") from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # what is wrong is raised; nothing is printed in addition
    options.use_deterministic_compute = True
    # Rewrites that keep each number as it is; further ones trade digits for speed.
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
    try:
        return onnxruntime.InferenceSession(
            data, options, providers=["CPUExecutionProvider"], enable_fallback=0
        )
    except Exception as error:  # the runtime raises of all kinds
        raise PolicyError(
            f"{where}: ONNX Runtime {onnxruntime.__version__} cannot load it: {_reason(error)}"
        ) from error


def _reason(error: BaseException) -> str:
    text = plain(" ".join(str(error).split())) or type(error).__name__
    return short(text.removeprefix("[ONNXRuntimeError] : "), 300)
