"""What an installation may take: pinned versions, and the hash of every file but PyTorch's."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LOCKS = ("requirements.lock", "requirements-dev.lock", "requirements-build.lock")
WITHOUT = {"torch"}
"""whose builds for CPU and CUDA are different files under one version"""


def plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def constraints() -> dict[str, str]:
    lines = (ROOT / "constraints.txt").read_text().split()
    return {plain(name): version for name, _, version in (line.partition("==") for line in lines)}


def locked() -> dict[str, tuple[str, int]]:
    """Version and number of hashes by package."""
    text = "\n".join((ROOT / name).read_text() for name in LOCKS)
    entries = re.split(r"\n(?=[A-Za-z])", text)
    found = {}
    for entry in entries:
        match = re.match(r"([A-Za-z0-9_.-]+)(?:\[[^]]*\])?==([^ ;\\]+)", entry)
        if match:
            found[plain(match[1])] = (match[2], len(re.findall(r"--hash=sha256:[0-9a-f]{64}\b", entry)))
    return found


def test_every_locked_package_has_hashes_and_the_pinned_version() -> None:
    pinned = constraints()
    found = locked()
    assert len(found) > 80
    for name, (version, hashes) in found.items():
        assert hashes > 0, name
        assert pinned[name] == version, f"{name}: make lock"


def test_what_an_installation_needs_is_locked() -> None:
    """The packages that pyproject.toml names; what they need in turn is the resolver's affair (`make lock`)."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    named = [*project["dependencies"], *extras["dev"], *extras["docs"], *extras["mpc"]]
    names = {plain(re.match(r"[A-Za-z0-9_.-]+", line)[0]) for line in named}  # type: ignore[index]
    assert names - {"auvbench"} - WITHOUT <= locked().keys(), "make lock"


def test_the_tools_of_an_installation_are_pinned() -> None:
    assert {"pip", "setuptools", "ray", "torch"} <= constraints().keys()
    assert {"pip", "setuptools"} <= locked().keys()
    recipe = (ROOT / "Makefile").read_text()
    assert recipe.count("--require-hashes") == 3
    assert "--upgrade pip" not in recipe


def test_no_lock_names_where_it_came_from() -> None:
    for name in ("constraints.txt", *LOCKS):
        assert "://" not in (ROOT / name).read_text()
