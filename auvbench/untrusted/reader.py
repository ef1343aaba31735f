"""Run the processes that read untrusted binary files: a server that forks one child per file, and the children.

`sandbox.py` starts this file as a program. This file imports nothing from auvbench, so that the program starts in a
fraction of a second.

A child has one connection, to the command that started it, and no other open file. Before it parses a byte, it sets
limits of memory and processor time, and gives up the right to open descriptors. So it can reach neither files nor the
network. It sends arrays of numbers as raw bytes: `receive` checks the type, shape and length of each array before
allocating memory.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import io
import json
import math
import os
import re
import resource
import signal
import socket
import struct
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

HEADER = 4 * 1024**2
"""largest size in bytes of a message's head, which is JSON with the note and the description of the arrays"""
ARRAY = 32 * 1024**2
"""Largest size in bytes of an array of an .npz; the positions of an episode take about ten thousand bytes"""
SMALL = 64 * 1024
"""total size of arrays in bytes below which a message is sent in one piece"""
DTYPES: dict[str, Any] = {
    np.dtype(kind).str: kind
    for kind in ("?", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f2", "f4", "f8")
}
"""Allowed types of arrays, by NumPy's type string (`dtype.str`)"""
ENDED, KILL = b"E", b"K"
"""Letters that ask the server to end a child: ENDED waits for the exit of a child whose channel is closed, KILL kills it at once"""
LENGTH, PID = struct.Struct("<Q"), struct.Struct("<i")

Arrays = dict[str, "np.ndarray[Any, Any]"]


class LimitError(ValueError):
    """A message is larger than its receiver allows."""


def send(channel: socket.socket, note: Mapping[str, Any], arrays: Mapping[str, Any] | None = None) -> None:
    """Send a note (a JSON object) and named arrays."""
    parts = {name: np.ascontiguousarray(array) for name, array in (arrays or {}).items()}
    shapes = [[name, part.dtype.str, np.shape(arrays[name])] for name, part in parts.items()]  # type: ignore[index]
    head = json.dumps({"note": note, "arrays": shapes}).encode()
    begin = LENGTH.pack(len(head)) + head
    if sum(part.nbytes for part in parts.values()) < SMALL:
        channel.sendall(begin + b"".join(part.tobytes() for part in parts.values()))
        return
    channel.sendall(begin)
    for part in parts.values():
        channel.sendall(part.reshape(-1).view(np.uint8).data)


def receive(channel: socket.socket, limit: int) -> tuple[Any, Arrays]:
    """Return a note (any JSON value) and named arrays, which may have at most `limit` bytes in total.

    Raises:
        EOFError: the other end has exited.
        LimitError: the arrays are larger than `limit`.
        ValueError: the message has a wrong format.
    """
    (length,) = LENGTH.unpack(_exactly(channel, np.empty(LENGTH.size, dtype=np.uint8)).tobytes())
    if length > HEADER:
        raise LimitError(f"a description of {length:,} bytes")
    try:
        head = json.loads(_exactly(channel, np.empty(length, dtype=np.uint8)).tobytes())
        entries = [(str(name), np.dtype(DTYPES[kind]), tuple(shape)) for name, kind, shape in head["arrays"]]
        note = head["note"]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise ValueError("it is not a description of arrays") from error
    arrays: Arrays = {}
    for name, dtype, shape in entries:
        if not all(type(n) is int and 0 <= n < 2**40 for n in shape) or len(shape) > 8 or name in arrays:
            raise ValueError("it is not a description of arrays")
        limit -= math.prod(shape) * dtype.itemsize
        if limit < 0:
            raise LimitError("arrays that are too large")
        arrays[name] = np.empty(shape, dtype)
        _exactly(channel, arrays[name].reshape(-1).view(np.uint8))
    return note, arrays


def _exactly(channel: socket.socket, into: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    view = into.data
    while view.nbytes:
        if not (count := channel.recv_into(view)):
            raise EOFError
        view = view[count:]
    return into


# A child.


def restrict(memory: int) -> None:
    """Forbid this process to open descriptors, start processes and write files; limit its memory to `memory` more bytes."""
    limits = [("RLIMIT_NOFILE", 0), ("RLIMIT_NPROC", 0), ("RLIMIT_FSIZE", 0), ("RLIMIT_CORE", 0)]
    with contextlib.suppress(OSError), open("/proc/self/statm", "rb") as file:
        pages = int(file.read().split()[0])
        limits.insert(0, ("RLIMIT_AS", pages * resource.getpagesize() + memory))
    for name, limit in limits:
        with contextlib.suppress(AttributeError, ValueError, OSError):  # not available on every system
            resource.setrlimit(getattr(resource, name), (limit, limit))


def grant(seconds: int) -> None:
    """Limit this process to `seconds` more seconds of processor time."""
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(time.process_time() + seconds), hard))


def serve(channel: socket.socket, job: Callable[..., None]) -> None:
    """Do one job: read the request, set limits, send the results. If the job fails, send the first line of the error."""
    try:
        note, arrays = receive(channel, 2**40)
        grant(note["seconds"])
        restrict(note["memory"])
        job(channel, arrays["data"].tobytes(), **note["options"])
    except MemoryError:
        send(channel, {"error": "memory"})
    except Exception as error:
        text = (str(error).strip() or type(error).__name__).splitlines()[0]
        send(channel, {"error": "text", "text": text[:2000]})


def table(channel: socket.socket, data: bytes, columns: list[str] | None, most: int) -> None:
    """Send the columns of a Parquet file, one message each, then the texts of its footer."""
    import pyarrow as pa
    from pyarrow import parquet

    footer = parquet.read_metadata(pa.BufferReader(data))
    schema = footer.schema.to_arrow_schema()
    if len(schema) > most:
        raise ValueError(f"it has {len(schema):,} columns, more than {most:,}")
    for field in schema:
        if not (pa.types.is_string(field.type) or _is_number(field.type)):
            raise ValueError(f"column {field.name[:40]} has the type {str(field.type)[:40]}")
    if len(set(schema.names)) < len(schema):
        raise ValueError("it has two columns of the same name")
    # With dictionary encoding, a long text that is in every row is in memory only once.
    file = parquet.ParquetFile(
        pa.BufferReader(data),
        read_dictionary=[field.name for field in schema if pa.types.is_string(field.type)],
        page_checksum_verification=True,
    )
    for name in schema.names:
        if columns is None or name in columns:
            values = file.read([name], use_threads=False).column(name)
            if pa.types.is_dictionary(values.type):
                send(channel, {"column": name}, _texts(values))
            elif (numbers := values.to_numpy()).dtype.str in DTYPES:
                send(channel, {"column": name}, {"values": numbers})
            else:
                raise ValueError(f"column {name[:40]} has gaps between values of the type {values.type}")
    notes = {key.decode(): value.decode() for key, value in (footer.metadata or {}).items()}
    send(channel, {"end": notes})


def _is_number(kind: Any) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind))


def _texts(values: Any) -> Arrays:
    """Return a column of texts as codes (-1: missing text), the distinct texts as one UTF-8 string, and the end of each in bytes."""
    encoded = values.unify_dictionaries().combine_chunks()
    if not hasattr(encoded, "indices"):  # pyarrow has returned a chunked array
        encoded = encoded.chunk(0) if encoded.num_chunks else None
    if encoded is None:
        return {"codes": np.empty(0, np.int32), "ends": np.empty(0, np.int64), "text": np.empty(0, np.uint8)}
    words = [word.encode() for word in encoded.dictionary.to_pylist()]
    codes = encoded.indices.to_numpy(zero_copy_only=False)  # floats with NaN if a text is missing
    return {
        "codes": np.where(np.isfinite(codes), codes, -1).astype(np.int32),
        "ends": np.cumsum([len(word) for word in words], dtype=np.int64),
        "text": np.frombuffer(b"".join(words), dtype=np.uint8),
    }


def paths(channel: socket.socket, data: bytes, condition: str, episodes: list[int] | int) -> None:
    """Send the arrays `<name>_<condition>_<episode>` of an .npz, for the listed episodes, or for the first n if `episodes` is n."""
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        named = re.compile(rf"([a-z_]+)_{re.escape(condition)}_(\d{{1,15}})")
        episode_of = {name: int(match[2]) for name in archive.files if (match := named.fullmatch(name))}
        first = sorted(set(episode_of.values()))[:episodes] if isinstance(episodes, int) else episodes
        chosen = {name: archive[name] for name, episode in episode_of.items() if episode in first}
    for name, array in chosen.items():
        if array.dtype.str not in ("<f2", "<f4", "<f8"):
            raise ValueError(f"{name} has the type {str(array.dtype)[:40]}, not of floating-point numbers")
        if array.nbytes > ARRAY:
            raise ValueError(f"{name} has {array.nbytes:,} bytes, more than {ARRAY:,}")
    send(channel, {"end": {}}, chosen)


def policy(channel: socket.socket, data: bytes) -> None:
    """Send the inputs and outputs of an ONNX file, then an answer for each request until the channel closes."""
    import onnxruntime

    onnxruntime.set_seed(0)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # errors are raised; nothing else is printed
    options.use_deterministic_compute = True
    # The basic optimisations do not change any number; stronger optimisations lose digits for speed.
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
    session = onnxruntime.InferenceSession(
        data, options, providers=["CPUExecutionProvider"], enable_fallback=0
    )
    ports = {
        kind: [[port.name, port.type, list(port.shape)] for port in arguments[:20]]
        for kind, arguments in (("inputs", session.get_inputs()), ("outputs", session.get_outputs()))
    }
    send(channel, ports)
    while True:
        try:
            note, arrays = receive(channel, 2**40)
        except EOFError:
            return
        grant(note["seconds"])
        begun = time.process_time()
        asked, rows = arrays["data"], note["rows"]
        answers = []
        for at in range(0, len(asked), rows):
            part = np.zeros((rows, asked.shape[1]), dtype=asked.dtype)
            part[: len(asked) - at] = asked[at : at + rows]
            (answer,) = session.run([ports["outputs"][0][0]], {ports["inputs"][0][0]: part})
            if np.shape(answer)[:1] != (rows,):
                raise ValueError(f"it answers {rows} observations with an array of shape {np.shape(answer)}")
            answers.append(np.asarray(answer, dtype=np.float32))
        action = np.concatenate(answers)[: len(asked)]
        send(channel, {"seconds": time.process_time() - begun}, {"action": action})


JOBS: dict[bytes, tuple[tuple[str, ...], Callable[..., None]]] = {
    b"T": (("pyarrow.parquet", "pyarrow.compute"), table),
    b"A": (("zipfile", "encodings.cp437", "encodings.latin_1"), paths),
    b"P": (("onnxruntime",), policy),
}
"""Jobs by letter: modules that the server imports once, and the function that a child calls"""


# The server.


def main(number: int) -> None:
    """Fork a child for each connection that arrives over the descriptor `number`, until the descriptor closes."""
    server = os.getpid()
    control = socket.socket(fileno=number)
    children: set[int] = set()
    while True:
        message, descriptors, _, _ = socket.recv_fds(control, 1 + PID.size, 1)
        if not message:
            return
        if not descriptors:
            pid = PID.unpack(message[1:])[0]
            control.sendall(PID.pack(_end(pid, message[:1] == ENDED) if pid in children else 0))
            children.discard(pid)
            continue
        modules, job = JOBS[message[:1]]
        for module in modules:
            with contextlib.suppress(ImportError):  # the child reports the error
                importlib.import_module(module)
        gc.freeze()  # A garbage collection would copy the pages that the children share.
        if (pid := os.fork()) == 0:
            with contextlib.suppress(BaseException):
                control.close()
                _die_with(server)
                serve(socket.socket(fileno=descriptors[0]), job)
            os._exit(0)
        os.close(descriptors[0])
        children.add(pid)
        control.sendall(PID.pack(pid))


def _die_with(parent: int) -> None:
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(1, signal.SIGKILL, 0, 0, 0)  # PR_SET_PDEATHSIG
    if os.getppid() != parent:
        os._exit(0)


def _end(pid: int, ended: bool) -> int:
    """End a child: with `ended`, wait up to a second for its exit; then kill it.

    Return the signal that ended the child; 0 if it exited by itself.
    """
    until = time.monotonic() + (1.0 if ended else 0.0)
    while not (status := os.waitpid(pid, os.WNOHANG))[0]:
        if time.monotonic() > until:
            os.kill(pid, signal.SIGKILL)
            status = os.waitpid(pid, 0)
            break
        time.sleep(0.001)
    return os.WTERMSIG(status[1]) if os.WIFSIGNALED(status[1]) else 0


if __name__ == "__main__":
    main(int(sys.argv[1]))
