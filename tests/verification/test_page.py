"""The page in the repository holds the present cases, all of them passed."""

from __future__ import annotations

from .page import PAGE, SECTIONS, all_cases, cell


def rows() -> list[list[str]]:
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    table = [line for line in lines if line.startswith("| ") and not line.startswith("| case |")]
    return [[entry.strip() for entry in line.strip("|").split(" | ")] for line in table]


def test_page_is_up_to_date_in_its_cases() -> None:
    """Run `make verification` after a case was added or changed."""
    written = [(row[0], row[1], row[3]) for row in rows()]
    assert written == [cell(case) for case in all_cases()]


def test_page_is_all_green() -> None:
    assert {row[4] for row in rows()} == {"pass"}
    assert f"**{len(rows())} of {len(rows())} cases pass.**" in PAGE.read_text(encoding="utf-8")


def test_every_section_has_cases() -> None:
    assert {case.section for case in all_cases()} == set(SECTIONS)
