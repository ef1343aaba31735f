"""The Python of docs/environments.md runs as it stands there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[3] / "docs" / "environments.md"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_examples_run():
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
    assert len(blocks) == 6
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)
    assert names["picture"].shape == (352, 832, 3)
    assert names["model"].num_timesteps >= 1024
    assert names["observation"].data_ptr() == names["batch"].task.observation.ctypes.data
