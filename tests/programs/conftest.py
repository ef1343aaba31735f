"""These tests install other people's programs: `make test-programs` (pytest -m programs) runs them, `make test` does not."""

from __future__ import annotations

import pytest


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if "programs" in (config.option.markexpr or ""):
        return
    for item in items:
        if item.get_closest_marker("programs"):
            item.add_marker(
                pytest.mark.skip(reason="installs gigabytes from the package index: make test-programs")
            )
