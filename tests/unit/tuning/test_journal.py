"""The journal: what a kill leaves, what damage is told, what another program did."""

import json

import pytest

from auvbench.errors import RunError
from auvbench.runs import lock
from auvbench.tuning.journal import CONTROLLER, Journal
from auvbench.tuning.rungs import FAILED
from auvbench.tuning.space import Dimension

DIMENSIONS = (
    Dimension("algo.a", "interval(0,1)", "float", 0.0, 1.0),
    Dimension("algo.d", "choice(x,y)", "choice", choices=("x", "y"), values=("x", "y")),
)
BUDGETS = (10, 30)


def result(score):
    return {"score": score, "objective": score, "low": 0.0, "high": 1.0, "then": 3.0, "runs": ["a"]}


def a_study(path):
    journal = Journal(path, DIMENSIONS, BUDGETS)
    for number, score in enumerate((0.5, 0.25, 0.75)):
        journal.start({"algo.a": score, "algo.d": "x"}, 0)
        journal.report(number, result(score))
    journal.promote(2)
    return journal


def state(journal):
    return journal.params, journal.progress, journal.results, journal.errors


def test_what_is_written_is_read_again(tmp_path):
    journal = a_study(tmp_path / "journal.log")
    journal.start({"algo.a": 0.1, "algo.d": "y"}, 0)
    journal.fail(3, "the weights became nan")
    again = Journal(tmp_path / "journal.log", DIMENSIONS, BUDGETS)
    assert state(again) == state(journal)
    assert again.progress[3].scores == {0: FAILED}
    again.report(2, result(0.9))
    again.close()
    last = Journal(tmp_path / "journal.log", DIMENSIONS, BUDGETS, write=False)
    assert [trial.state.name for trial in last.trials()] == ["PRUNED", "PRUNED", "COMPLETE", "FAIL"]


def test_a_kill_after_any_byte_loses_no_whole_event(tmp_path):
    path = tmp_path / "journal.log"
    a_study(path)
    data = path.read_bytes()
    whole = data.count(b"\n")
    for cut in range(len(data) - 1, 0, -37):
        path.write_bytes(data[:cut])
        journal = Journal(path, DIMENSIONS, BUDGETS)
        assert bool(journal.repaired) == (not data[:cut].endswith(b"\n"))
        assert path.read_bytes().count(b"\n") >= data[:cut].count(b"\n")
        journal.start({"algo.a": 0.3, "algo.d": "y"}, 0)
        assert Journal(path, DIMENSIONS, BUDGETS).params[-1] == {"algo.a": 0.3, "algo.d": "y"}
    assert whole > 10


def test_a_last_line_that_is_cut_short_is_kept_beside(tmp_path):
    path = tmp_path / "journal.log"
    journal = a_study(path)
    with open(path, "ab") as file:
        file.write(b'{"op_code":8,"work')
    assert state(Journal(path, DIMENSIONS, BUDGETS, write=False)) == state(journal)
    again = Journal(path, DIMENSIONS, BUDGETS)
    assert "cut short" in again.repaired
    assert (tmp_path / "journal.log.torn").read_bytes() == b'{"op_code":8,"work\n'
    assert state(again) == state(journal)


@pytest.mark.parametrize("line", [3, 7])
@pytest.mark.parametrize("bad", [b"no json at all", b'{"op_code": "x"}', b"[1]", b"\xff\xfe"])
def test_damage_in_the_middle_is_named_and_nothing_is_touched(tmp_path, line, bad):
    path = tmp_path / "journal.log"
    a_study(path)
    lines = path.read_bytes().split(b"\n")
    lines[line - 1] = bad
    path.write_bytes(b"\n".join(lines))
    before = path.read_bytes()
    with pytest.raises(RunError, match=f"line {line} of {len(lines) - 1} is damaged") as caught:
        Journal(path, DIMENSIONS, BUDGETS)
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == before


@pytest.mark.parametrize("line", [4, 14])
def test_an_event_of_another_version_is_named_and_not_cut_off(tmp_path, line):
    path = tmp_path / "journal.log"
    a_study(path)
    lines = path.read_bytes().splitlines()
    lines[line - 1] = json.dumps({**json.loads(lines[line - 1]), "op_code": 99}).encode()
    path.write_bytes(b"\n".join([*lines, b""]))
    before = path.read_bytes()
    with pytest.raises(RunError, match=rf"line {line}: an event of kind 99.*use the auvbench that wrote it"):
        Journal(path, DIMENSIONS, BUDGETS)
    assert path.read_bytes() == before


def test_who_lost_the_study_writes_no_more_into_it(tmp_path):
    path = tmp_path / "journal.log"
    journal = a_study(path)
    place = tmp_path / CONTROLLER
    place.mkdir()
    with lock.acquire(place):
        (place / lock.FOLDER / lock.HOLDER).unlink()
        before = path.read_bytes()
        with pytest.raises(lock.LockLostError):
            journal.start({"algo.a": 0.1, "algo.d": "y"}, 0)
        assert path.read_bytes() == before


def test_events_that_make_no_study_are_refused(tmp_path):
    path = tmp_path / "journal.log"
    a_study(path)
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[1:]))  # without the event that made the study
    with pytest.raises(RunError, match=r"journal\.log"):
        Journal(path, DIMENSIONS, BUDGETS).start({"algo.a": 0.3, "algo.d": "y"}, 0)


def test_trials_of_another_space_are_refused(tmp_path):
    path = tmp_path / "journal.log"
    a_study(path)
    with pytest.raises(RunError, match="trial 0 is not of this study's space"):
        Journal(path, DIMENSIONS[:1], BUDGETS)


def test_a_score_that_is_none_is_refused(tmp_path):
    path = tmp_path / "journal.log"
    a_study(path)
    edited = []
    for line in path.read_text().splitlines():
        event = json.loads(line)
        for name in list(event.get("user_attr", {})):
            if name.startswith("result"):
                event["user_attr"][name]["score"] = "good"
        edited.append(json.dumps(event))
    path.write_text("\n".join(edited) + "\n")
    with pytest.raises(RunError, match="has no score after 10 steps"):
        Journal(path, DIMENSIONS, BUDGETS)
