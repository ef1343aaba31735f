"""The processes that read foreign files: their limits, their rights, and what the command believes of them."""

from __future__ import annotations

import io
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvbench.untrusted import archives, reader, sandbox
from tests.waiting import until


def npz(**arrays: Any) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


SMALL = npz(position_a_0=np.ones(3), position_b_0=np.zeros(3), position_a_1=np.zeros(2))


def test_arrays_of_one_condition_come_back_with_their_bits() -> None:
    found = archives.paths(SMALL, "a", 1)
    assert list(found) == ["position_a_0"]
    np.testing.assert_array_equal(found["position_a_0"], np.ones(3))
    assert list(archives.paths(SMALL, "a", [1])) == ["position_a_1"]
    assert archives.paths(SMALL, "c", 5) == {}


def test_a_server_that_was_killed_is_started_again() -> None:
    archives.paths(SMALL, "a", 1)
    assert sandbox._server is not None
    sandbox._server._process.kill()
    sandbox._server._process.wait()
    assert len(archives.paths(SMALL, "a", 2)) == 2


def test_the_server_has_one_thread_whatever_it_reads() -> None:
    pytest.importorskip("onnxruntime")
    for job in (sandbox.TABLE, sandbox.PATHS, sandbox.POLICY):
        with pytest.raises(ValueError, match=r"^[^\n]+$"), sandbox.Child(job, b"no such file") as child:
            child.answer()
    assert sandbox._server is not None
    assert len(os.listdir(f"/proc/{sandbox._server._process.pid}/task")) == 1


# What a child may do: jobs of this test, forked from here.


def asked(job: Any, *, memory: int = 2**28, seconds: int = 60) -> tuple[Any, Any]:
    """The first message of a job in a process of its own, after its limits; its end is an EOFError."""
    mine, theirs = socket.socketpair()
    if (pid := os.fork()) == 0:
        mine.close()
        reader.serve(theirs, job)
        os._exit(0)
    theirs.close()
    try:
        reader.send(
            mine, {"seconds": seconds, "memory": memory, "options": {}}, {"data": np.empty(0, np.uint8)}
        )
        return reader.receive(mine, 2**20)
    finally:
        mine.close()
        os.waitpid(pid, 0)


def opens_a_file(channel: socket.socket, data: bytes) -> None:
    open("/etc/hostname").close()


def opens_a_connection(channel: socket.socket, data: bytes) -> None:
    socket.socket()


def starts_a_process(channel: socket.socket, data: bytes) -> None:
    subprocess.run(["true"], check=False)


def takes_memory(channel: socket.socket, data: bytes) -> None:
    np.ones(2**27)


@pytest.mark.parametrize("job", [opens_a_file, opens_a_connection, starts_a_process])
def test_a_child_reaches_no_file_no_network_and_no_other_program(job: Any) -> None:
    assert asked(job)[0]["error"] == "text"
    assert "Too many open files" in asked(job)[0]["text"]


def test_a_child_that_takes_too_much_memory_says_so() -> None:
    assert asked(takes_memory)[0] == {"error": "memory"}


# What the command believes.


class Impostor:
    """A server whose child sends some bytes, and nothing more."""

    def __init__(self, data: bytes, *, ends: bool = True) -> None:
        self.mine, self.theirs = socket.socketpair()
        self.theirs.sendall(data)
        if ends:
            self.theirs.shutdown(socket.SHUT_WR)
        self.ended: list[bytes] = []

    def end(self, letter: bytes, pid: int) -> int:
        self.ended.append(letter)
        return 0


@pytest.fixture
def impostor(monkeypatch: pytest.MonkeyPatch) -> Any:
    def made(data: bytes, **options: Any) -> sandbox.Child:
        server = Impostor(data, **options)
        monkeypatch.setattr(sandbox, "_fork", lambda job: (server.mine, 1, server))
        return sandbox.Child(sandbox.PATHS, b"", seconds=1)

    monkeypatch.setattr(sandbox, "PATIENCE", 0.05)
    return made


def message(head: Any, payload: bytes = b"") -> bytes:
    text = head if isinstance(head, bytes) else json.dumps(head).encode()
    return reader.LENGTH.pack(len(text)) + text + payload


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"", "has died"),
        (b"\x01", "has died"),
        (reader.LENGTH.pack(2**63), "unpacks to more than"),
        (message(b"[" * 100_000), "an invalid answer"),
        (message(b"{}"), "an invalid answer"),
        (message(b"null"), "an invalid answer"),
        (message({"note": [], "arrays": []}), "an invalid answer"),
        (message({"note": {}, "arrays": [["a", "|O8", [1]]]}), "an invalid answer"),
        (message({"note": {}, "arrays": [["a", "<f8", [-1]]]}), "an invalid answer"),
        (message({"note": {}, "arrays": [["a", "<f8", [True]]]}), "an invalid answer"),
        (message({"note": {}, "arrays": [["a", "<f8", [2**39]]]}), "unpacks to more than"),
        (message({"note": {}, "arrays": [["a", "<f8", [2**20] * 8]]}), "unpacks to more than"),
        (
            message({"note": {}, "arrays": [["a", "<f8", [1]], ["a", "<f8", [1]]]}, bytes(16)),
            "an invalid answer",
        ),
        (message({"note": {}, "arrays": [["a", "<f8", [4]]]}, bytes(31)), "has died"),
        (message({"note": {"error": "text", "text": "a\nb\x1b[31m"}, "arrays": []}), r"a\\nb\\x1b"),
        (message({"note": {"error": {}}, "arrays": []}), "None"),
    ],
)
def test_a_child_that_lies_is_one_line(impostor: Any, data: bytes, what: str) -> None:
    with pytest.raises(ValueError, match=what) as caught:
        impostor(data).answer()
    assert str(caught.value).isprintable()


def test_a_child_that_says_nothing_is_given_up(impostor: Any) -> None:
    child = impostor(b"", ends=False)
    with pytest.raises(ValueError, match="takes longer than 1 s"):
        child.answer()
    assert child._server.ended == [sandbox.KILL]


@pytest.mark.slow
def test_children_end_with_their_command(tmp_path: Path) -> None:
    pytest.importorskip("onnx")
    from tests.onnx_files import model, saved

    path = saved(tmp_path / "mine.onnx", model())
    script = f"""
import os, signal, sys
sys.argv = ["auvbench"]
from auvbench.policies import exported
from auvbench.untrusted import sandbox
policy = exported.load({str(path)!r})
print(sandbox._server._process.pid, policy._child.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    for pid in done.stdout.split():
        until(lambda pid=pid: not _runs(pid))


def _runs(pid: str) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
