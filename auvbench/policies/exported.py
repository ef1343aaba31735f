"""A policy as a file: an ONNX network and, beside it, a card in JSON that says what its numbers mean.

Reading one needs NumPy and ONNX Runtime alone (`pip install onnxruntime`): no torch, no Stable-Baselines3, nothing that is
compiled. The network takes raw observations (n, 4 + n_u) in the units of the environment and answers with actions
(n, n_u) in [-1, 1]; scaling and clipping are in the file. Files and cards may come from anybody: they are bounded and
looked at (`auvbench/untrusted/onnx_file.py`) before a runtime gets them.

The card is `auvbench/policies/cards.py`.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import MissingExtraError
from auvbench.policies.cards import MOST, Card, PolicyError, card_path, content, parse_card, unread
from auvbench.untrusted import onnx_file, reading
from auvbench.untrusted.onnx_file import OnnxFile, Port
from auvbench.untrusted.text import plain, short

Floats = NDArray[np.float32]

NETWORK, CARD = "policy.onnx", "policy.json"
"""The files of a run of `algo=onnx`, in its `model/`."""

SLACK = 1e-6
"""by which an action may leave [-1, 1], for rounding; it is clipped then"""

ROWS = 64
"""of each forward pass: matrix products of another shape may round differently, and an answer must not depend on how
many are asked for together"""


class Policy:
    """A network that is ready to act.

    Args:
        data: the ONNX file.
        where: its name, for messages.
        observations: length of an observation; None where any will do.
        actions: number of actuators; None where any will do.
        card: of the file, if there is one.
        rows: of each forward pass (see `ROWS`); 1 acts fastest on one observation.

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
        self.file = check(data, where, observations=observations, actions=actions, card=card)
        entry, answer = self.file.inputs[0], self.file.outputs[0]
        self.n_observations = _width(entry, card.observation if card else None, observations)
        self.n_actions = _width(answer, card.action if card else None, actions)
        self._session = _session(data, where)
        self._input, self._output = entry.name, answer.name
        self._type = np.float64 if entry.type == "float64" else np.float32
        fixed = entry.shape[0] if entry.shape else None
        self._rows = fixed if fixed is not None else rows

    def act(self, observation: NDArray[np.floating]) -> Floats:
        """Actions (n, n_u) in [-1, 1] for raw observations (n, 4 + n_u) in their units.

        Raises:
            PolicyError: it answers with a NaN, an infinity, an action out of range, or one of another shape.
        """
        given = np.ascontiguousarray(observation, dtype=self._type)
        if given.ndim != 2:
            raise PolicyError(f"{self.where}: was given observations of shape {given.shape}, not (n, length)")
        parts = [self._pass(given[at : at + self._rows]) for at in range(0, len(given), self._rows)]
        action = np.concatenate(parts) if parts else np.zeros((0, self.n_actions or 0), dtype=np.float32)
        self._refuse(given, action)
        return np.clip(action, -1.0, 1.0)

    def _pass(self, part: NDArray[Any]) -> Floats:
        rows = part
        if len(part) < self._rows:
            rows = np.zeros((self._rows, part.shape[1]), dtype=part.dtype)
            rows[: len(part)] = part
        try:
            (answer,) = self._session.run([self._output], {self._input: rows})
        except Exception as error:  # the runtime raises of all kinds
            raise PolicyError(f"{self.where}: cannot be computed: {_reason(error)}") from error
        wanted = (len(rows), self.n_actions) if self.n_actions else (len(rows), *np.shape(answer)[1:2])
        if np.shape(answer) != wanted:
            raise PolicyError(
                f"{self.where}: answers {len(rows)} observations with an array of shape {np.shape(answer)}; "
                f"must be ({len(rows)}, {self.n_actions or 'actuators'})"
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
    """Reads an ONNX file and the card beside it, if there is one.

    Args:
        path: of the ONNX file.
        observations: length of an observation; None where any will do.
        actions: number of actuators; None where any will do.
        rows: of each forward pass; 1 acts fastest on one observation.

    Raises:
        PolicyError: one of them is missing, damaged, foreign, of another shape, or holds what is refused.
        MissingExtraError: ONNX Runtime is not installed.
    """
    data, card, _ = read(path)
    return Policy(data, str(path), observations=observations, actions=actions, card=card, rows=rows)


def read(path: Path | str) -> tuple[bytes, Card | None, bytes | None]:
    """An ONNX file's bytes, its card, and the card's bytes; None where no card lies beside it.

    Raises:
        PolicyError: one of them cannot be read, or the card is of another file.
    """
    path = Path(path)
    if path.suffix == ".json" or path.is_dir():
        what = "is a folder" if path.is_dir() else "is a card"
        raise PolicyError(f"{path}: {what}; name the ONNX file")
    data = content(path, onnx_file.LARGEST)
    beside = card_path(path)
    try:
        text = reading.content(beside)
    except FileNotFoundError:
        return data, None, None
    except (OSError, ValueError) as error:
        raise PolicyError(f"{beside}: {unread(error)}") from error
    card = parse_card(text, str(beside))
    if card is None:
        return data, None, None
    if card.sha256 != hashlib.sha256(data).hexdigest():
        raise PolicyError(
            f"{beside}: is the card of another file than {path.name} (its sha256 differs); "
            "export again, or remove the card"
        )
    return data, card, text


def check(
    data: bytes,
    where: str,
    *,
    observations: int | None = None,
    actions: int | None = None,
    card: Card | None = None,
) -> OnnxFile:
    """What an ONNX file says of itself, if it is a policy of these sizes. Needs no runtime.

    Args:
        data: the file.
        where: its name, for messages.
        observations, actions: lengths; None where any will do.
        card: whose names must be as many as the file's inputs and outputs.

    Raises:
        PolicyError: it is none.
    """
    try:
        found = onnx_file.inspect(data)
    except ValueError as error:
        raise PolicyError(f"{where}: {error}") from error
    for kind, ports, wanted, named in (
        ("input", found.inputs, observations, card.observation if card else None),
        ("output", found.outputs, actions, card.action if card else None),
    ):
        if len(ports) != 1:
            listed = ", ".join(map(str, ports[:6])) or "none"
            what = "observation (n, 4 + actuators)" if kind == "input" else "action (n, actuators)"
            raise PolicyError(f"{where}: has {len(ports)} {kind}s ({listed}); a policy has one, the {what}")
        if wrong := _port_fault(ports[0], wanted):
            raise PolicyError(f"{where}: its {kind} {ports[0]} {wrong}")
        width = ports[0].shape[1] if ports[0].shape else None
        if named is not None and width is not None and width != len(named):
            raise PolicyError(
                f"{where}: its {kind} {ports[0]} has not the {len(named)} entries that its card names"
            )
    return found


def _port_fault(port: Port, wanted: int | None) -> str:
    if port.type not in ("float32", "float64"):
        return "must be float32 or float64"
    if port.shape is None:
        return ""  # the first answer will tell
    lengths = "length" if wanted is None else str(wanted)
    if port.shape[:1] and (port.shape[0] or 0) > MOST:
        return f"must take any number of observations at once, or at most {MOST}"
    if len(port.shape) != 2:
        return f"must have two dimensions, (n, {lengths})"
    if wanted is not None and port.shape[1] not in (None, wanted):
        return f"must be (n, {wanted}) for this vehicle and task"
    return ""


def _width(port: Port, named: tuple[str, ...] | None, wanted: int | None) -> int | None:
    declared = port.shape[1] if port.shape else None
    return declared or wanted or (len(named) if named is not None else None)


def _session(data: bytes, where: str) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise MissingExtraError("onnxruntime", extra="onnx", purpose="policies as ONNX files") from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # what is wrong is raised; nothing is printed beside it
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
