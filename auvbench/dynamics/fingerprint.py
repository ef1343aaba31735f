"""A number that changes when compiled code would.

numba's on-disk cache looks at the file of a function and not at what the function calls or which constants it
imports: after a change in another file it would go on running the old code. A compiled function that is cached and
reaches across files therefore carries this number in its closure, which is part of the cache's key; what it calls
is compiled with it and not cached by itself.
"""

from __future__ import annotations

import hashlib
from pathlib import Path


def fingerprint(*folders: Path) -> int:
    """A 60-bit number from the names and contents of all Python files in `folders`."""
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted(folder.glob("*.py")):
            digest.update(path.name.encode())
            digest.update(path.read_bytes())
    return int.from_bytes(digest.digest()[:8], "big") >> 4
