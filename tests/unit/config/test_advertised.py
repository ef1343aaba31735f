"""What is said of the ready-made grids where they are advertised."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from omegaconf import OmegaConf

from auvbench.analysis import thesis
from auvbench.analysis.claims import WEAK
from auvbench.analysis.evidence import partial_rank_correlation, trend
from auvbench.config.compose import compose
from auvbench.registry import COMMANDS
from tests import configuration_page

ROOT = Path(__file__).parents[3]


def grid(algo: str) -> dict[str, Any]:
    text = (ROOT / "conf" / "experiment" / "thesis_small.yaml").read_text(encoding="utf-8")
    (found,) = [one for one in yaml.safe_load(text)["hydra"]["sweeper"]["grids"] if one["algo"] == algo]
    assert isinstance(found, dict)
    return found


def values(algo: str, key: str) -> list[float]:
    return [float(value) for value in grid(algo)[key].split(",")]


def test_every_command_has_a_row_in_the_page_of_commands() -> None:
    text = (ROOT / "docs" / "grammar.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^\| `auvbench ([\w-]+)", text, re.M)) == sorted(COMMANDS)


def test_thesis_small_can_answer_the_7th_claim_and_not_the_1st_2nd_and_5th() -> None:
    # 1: no SAC at 55 Hz, and too few steps to say that a run does not converge. 5: the same.
    assert thesis.HIGH_FREQUENCY not in values("sac", "step.frequency")
    assert float(grid("sac")["train.total_steps"]) < thesis.STEPS
    # 2: with one seed in two strata no trend can be resolved, however clear.
    assert len(grid("sac")["seed"].split(",")) == 1
    points = [(str(k), f, f) for k in values("sac", "reward.k") for f in values("sac", "step.frequency")]
    clear = trend(points)
    assert clear is not None
    assert clear.p_up > 0.2
    # 4: most of the thesis's cells are absent. 6: with so few agents even a correlation of 0 is not within the margin.
    assert len(points) < len(thesis.CELLS)
    agents = len(points) + 9
    order, constant = np.arange(agents, dtype=float), np.zeros(agents)
    none = partial_rank_correlation(order, _uncorrelated(agents), constant, agents, 0.95)
    assert none.value == pytest.approx(0.0, abs=0.05)
    assert none.high > WEAK
    # 7: its three parts have their cells.
    assert {10.0, 25.0} <= set(values("sac", "step.frequency")) & set(values("ppo", "step.frequency"))


def _uncorrelated(n: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """A permutation of 0 to n - 1 whose rank correlation with their order is nearly none."""
    rng = np.random.default_rng(0)
    every = (rng.permutation(n).astype(float) for _ in range(2000))
    return min(every, key=lambda order: abs(np.corrcoef(np.arange(n), order)[0, 1]))


def test_the_page_of_configuration_keys_is_that_of_the_files() -> None:
    text = configuration_page.page()
    assert configuration_page.PAGE.read_text(encoding="utf-8") == text, "python -m tests.configuration_page"
    shown = set(re.findall(r"^\| `([\w.]+)`", text, re.M))
    composed = pd.json_normalize(OmegaConf.to_container(compose("train", ["algo=sac", "launcher=slurm"])))
    for key in composed.columns:
        parts = key.split(".")
        if parts[0] != "vehicle" and parts[-1] not in configuration_page.FIXED:
            assert shown & {".".join(parts[: i + 1]) for i in range(len(parts))}, key


def test_a_meaning_that_goes_on_below_its_line_is_whole(tmp_path: Path) -> None:
    file = tmp_path / "keys.yaml"
    file.write_text(
        "one: 1    # steps, counted\n"
        "          # from zero\n"
        "two: 2\n"
        "block:    # not a key\n"
        "  # m, in\n"
        "  # the world\n"
        "  three: 3\n"
    )
    found = {key.path: key.meaning for key in configuration_page.keys(file)}
    assert found == {"one": "steps, counted from zero", "two": "", "block.three": "m, in the world"}


def test_every_key_has_a_meaning_that_begins_with_its_noun() -> None:
    rows = re.findall(r"^\| `([\w.]+)` .* \| (.*) \|$", configuration_page.page(), re.M)
    assert len(rows) > 400
    words = "after|added|and|at|by|for|from|in|of|on top|that|to|with"
    wrong = [
        f"{key}: {meaning}" for key, meaning in rows if not meaning or re.match(rf"({words})\b", meaning)
    ]
    assert wrong == []
