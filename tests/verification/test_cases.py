"""Every line of the verification page, on the compiled simulator."""

from __future__ import annotations

import pytest

from .case import Case
from .page import all_cases

CASES = all_cases()


@pytest.mark.parametrize("case", CASES, ids=[case.key for case in CASES])
def test_case(case: Case) -> None:
    got = case.got()
    assert case.passes(got), f"expected {case.expected:.9g} +- {case.tolerance:g} {case.unit}, got {got:.9g}"


def test_names_are_unique() -> None:
    assert len({case.key for case in CASES}) == len(CASES)
