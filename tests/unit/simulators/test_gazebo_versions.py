"""Versions of Gazebo's libraries stand in one order, however a process maps them."""

from types import SimpleNamespace

from auvbench.integrations.gazebo import bindings
from benchmarks.gazebo import parity

MAPS = """\
7f00-7f01 r-xp 0 00:00 0 /nowhere/libgz-sim8.so.8.14.0
7f02-7f03 r-xp 0 00:00 0 /nowhere/libsdformat14.so.14.9.0
7f04-7f05 r-xp 0 00:00 0 /nowhere/libdart.so.6.12.1
7f06-7f07 r-xp 0 00:00 0
"""


def test_versions_are_sorted(monkeypatch):
    monkeypatch.setattr(bindings, "Path", lambda _: SimpleNamespace(read_text=lambda encoding: MAPS))
    assert list(bindings.used().items()) == [
        ("dart", "6.12.1"),
        ("gz-sim8", "8.14.0"),
        ("sdformat14", "14.9.0"),
    ]
    names = [entry.split()[0] for entry in parity.environment().partition(";")[0].split(", ")]
    assert names == ["dart", "gz-sim8", "numpy", "python", "sdformat14"]
