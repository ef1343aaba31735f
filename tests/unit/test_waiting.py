"""Waiting for an event while files come and go."""

from __future__ import annotations

from tests.waiting import until


def test_a_folder_that_is_renamed_while_it_is_listed_is_listed_again() -> None:
    answers = iter([FileNotFoundError("checkpoints/.64.staged"), [], ["checkpoints/64"]])

    def listed() -> list[str]:
        answer = next(answers)
        if isinstance(answer, FileNotFoundError):
            raise answer
        return answer

    assert until(listed) == ["checkpoints/64"]
