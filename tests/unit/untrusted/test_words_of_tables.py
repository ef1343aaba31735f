"""A name is what is written, whatever it would be as a number."""

import numpy as np
import pytest

from auvbench.cli import main
from auvbench.untrusted import tables
from tests.synthetic import write_experiment

NAMES = ["NA", "1.30", "nan", "", "null", "-0"]


def test_words_stay_words_and_numbers_may_be_missing():
    rows = "".join(f"{name},{i},\n" for i, name in enumerate(NAMES))
    found = tables.csv(f"condition,steps,energy_J\n{rows}NA,7,nan\n".encode(), words=("condition",))
    assert found["condition"].tolist() == [*NAMES, "NA"]
    assert found["steps"].tolist() == [0, 1, 2, 3, 4, 5, 7]
    assert np.isnan(found["energy_J"]).all()


def test_words_that_are_not_there_are_not_asked_for():
    assert tables.csv(b"steps\n1\n2\n", words=("condition",))["steps"].tolist() == [1, 2]


@pytest.mark.parametrize("data", [b"", b"\x00\xff,\n1", b'a,b\n"1,2\n'])
def test_no_table(data):
    with pytest.raises(ValueError, match=r"\w"):
        tables.csv(data, words=("a",))


@pytest.mark.slow
def test_a_condition_called_not_available_is_reported(tmp_path, capsys):
    write_experiment(tmp_path / "grid", algorithms=("pid",), protocols={"test": ("nominal", "NA")})
    assert main(["report", str(tmp_path / "grid"), "--condition", "NA"]) == 0
    assert "condition NA" in capsys.readouterr().out
