"""The order of the tests, and what a slow machine leaves out."""

from __future__ import annotations

from typing import Any

import pytest

from tests import conftest


class Item:
    def __init__(self, name: str) -> None:
        self.name = name

    def get_closest_marker(self, marker: str) -> object:
        return marker == "long" and self.name.isupper()


def test_each_process_begins_with_its_share_of_the_long_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTEST_XDIST_WORKER_COUNT", "2")
    items: list[Any] = [Item(name) for name in "aLbMcNd"]
    conftest.pytest_collection_modifyitems(items)
    assert "".join(item.name for item in items) == "LNabMcd"


def test_a_long_test_that_did_not_begin_in_time_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    quick: Any = Item("quick")
    long: Any = Item("LONG")
    monkeypatch.delenv("AUVBENCH_LONG_UNTIL", raising=False)
    conftest.pytest_runtest_setup(long)
    monkeypatch.setenv("AUVBENCH_LONG_UNTIL", "9e9")
    conftest.pytest_runtest_setup(long)
    monkeypatch.setenv("AUVBENCH_LONG_UNTIL", "1.0")
    conftest.pytest_runtest_setup(quick)
    with pytest.raises(pytest.skip.Exception, match="slow machine"):
        conftest.pytest_runtest_setup(long)
