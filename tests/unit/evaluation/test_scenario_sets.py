"""Names of scenario sets: the page is generated, and the newest version of each set is what the code draws."""

from __future__ import annotations

import re

import pytest

from auvbench.evaluation import scenario_sets
from auvbench.evaluation.scenario_sets import SETS, VEHICLES, newest
from auvbench.registry import TASKS
from tests.scenario_page import PAGE, computed, page


def test_the_page_is_the_one_that_is_generated() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "python -m tests.scenario_page writes it"


def test_each_task_has_a_set_and_names_are_unique() -> None:
    assert set(newest()) == set(TASKS.own)
    names = [one.name for one in SETS]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r"20\d\d[a-z]", one.version) for one in SETS)
    digests = [digest for one in SETS for digest in one.fingerprints]
    assert len(set(digests)) == len(digests) == len(SETS) * len(VEHICLES)


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS.own)
def test_the_newest_version_is_what_the_code_draws(task: str) -> None:
    found = tuple(computed(task, vehicle) for vehicle in VEHICLES)
    assert found == newest()[task].fingerprints, (
        f"the scenarios of {task} have changed: give the set a new version (docs/scenario-sets.md), with {found}"
    )


def test_a_report_names_the_set() -> None:
    one = SETS[0]
    assert scenario_sets.cited(one.fingerprints[0]) == f"{one.name} ({one.fingerprints[0]})"
    assert scenario_sets.cited("0" * 16) == "0" * 16
