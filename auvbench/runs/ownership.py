"""Which runs and studies this user made.

Copied and unpacked folders have the user's uid, so a uid says nothing. The user has a random key in the state directory,
which hosts of a cluster share with the home directory. `maker`, next to config.yaml or study.json, holds the keyed hash
(HMAC-SHA256) of that file: without the key it cannot be written.
"""

from __future__ import annotations

import hmac
import os
import secrets
from contextlib import suppress
from functools import cache
from pathlib import Path

from auvbench.runs.atomic_io import create_atomic, write_atomic
from auvbench.untrusted import reading
from auvbench.untrusted.path_safety import child

MAKER = "maker"
_LENGTH = 32  # bytes of the key


def state_folder() -> Path:
    """Return the user's folder for what auvbench keeps between commands."""
    state = os.environ.get("XDG_STATE_HOME") or os.path.join(os.path.expanduser("~"), ".local", "state")
    return Path(state, "auvbench")


def sign(file: Path) -> None:
    """Record that this user made the run or study of `file`; do nothing where no key can be kept."""
    with suppress(OSError, ValueError):
        write_atomic(child(file.parent, MAKER), _hash(file).encode())


def is_own(file: Path) -> bool:
    """Return whether this user made the run or study of `file`, and the file is as it was then."""
    try:
        found = reading.content(child(file.parent, MAKER), 1000)
        return hmac.compare_digest(found, _hash(file).encode())
    except (OSError, ValueError):
        return False


def _hash(file: Path) -> str:
    """Return the keyed hash of a file and its name.

    Raises:
        OSError, ValueError: the file or the key cannot be read.
    """
    message = file.name.encode() + b"\0" + reading.content(file)
    return hmac.digest(_key(state_folder() / "key"), message, "sha256").hex()


@cache
def _key(path: Path) -> bytes:
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        create_atomic(path, secrets.token_bytes(_LENGTH), mode=0o600)  # of two processes one makes it
    key = reading.content(path)
    if len(key) != _LENGTH:
        raise ValueError(f"{path}: not a key; remove it")
    return key
