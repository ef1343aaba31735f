"""Save the details of an error, such as its traceback, that do not fit into the error's one-line message."""

from __future__ import annotations

import os
import tempfile
import time
import traceback
import uuid
from pathlib import Path

from auvbench.errors import AgentError, AuvbenchError, PluginImportError
from auvbench.runs.lock import state_folder


def save(content: str) -> Path | None:
    """Write `content` to a new error file and return the file's path; None if no folder is writable."""
    name = f"error-{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}-{uuid.uuid4().hex[:6]}.txt"
    for folder in (state_folder(), Path(tempfile.gettempdir())):
        path = folder / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with open(path, "x", encoding="utf-8", errors="backslashreplace") as file:
                file.write(content)
        except OSError:
            continue
        return path
    return None


def is_foreign(error: BaseException) -> bool:
    """Return whether an error was caused by an exception in an installed package."""
    cause = error.__cause__
    while isinstance(cause, AuvbenchError):
        cause = cause.__cause__
    return isinstance(error, AgentError | PluginImportError) and cause is not None


def naming_traceback(error: BaseException) -> str:
    """Return the error's text; for an error of an installed package, save the traceback and append the path of the saved file."""
    path = save("".join(traceback.format_exception(error))) if is_foreign(error) else None
    return f"{error}; traceback: {path}" if path else str(error)
