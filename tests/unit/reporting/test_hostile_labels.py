"""Labels out of files from anywhere: formulas, markup, mathematics, escape sequences, and twenty thousand letters."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import matplotlib as mpl
import pytest
import yaml
from matplotlib.figure import Figure

from auvbench import cli
from auvbench.analysis.labels import labels, part
from auvbench.reporting.figures import style
from auvbench.runs import identity, integrity
from tests import synthetic

NAMES = (
    "=HYPERLINK(1)",
    "+1+1",
    "-x",
    "@SUM",
    r"$\frac{1}{0}$ $",
    "[b][red]",
    "<script>alert(1)<script>",
    "$$$",
)


def renamed(run: Path, name: str) -> Path:
    """The run with another `algo.name`, all its files in agreement."""
    config = yaml.safe_load((run / "config.yaml").read_text())
    config["algo"]["name"] = name
    (run / "config.yaml").write_text(yaml.safe_dump(config))
    new = identity.run_id(config)
    manifest = json.loads((run / "manifest.json").read_text()) | {"id": new, "algo": name}
    (run / "manifest.json").write_text(json.dumps(integrity.sealed(manifest)))
    for path in run.glob("evaluations/*/summary.json"):
        path.write_text(json.dumps(integrity.sealed(json.loads(path.read_text()) | {"run": new})))
    return run.rename(run.with_name(new.replace("/", "_")[:150]))


@pytest.mark.parametrize("flags", [["--no-figures"], pytest.param([], marks=pytest.mark.slow)])
def test_a_label_is_text_everywhere(
    flags: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written = synthetic.write_experiment(
        tmp_path / "x", algorithms=("ppo",), seeds=range(len(NAMES)), episodes=8
    )
    for run, name in zip(written, NAMES, strict=True):
        renamed(run, name)
    assert cli.main(["report", str(tmp_path / "x"), "--format", "terminal,csv,md,html,tex", *flags]) == 0
    capsys.readouterr()
    with open(tmp_path / "x" / "report" / "table.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(NAMES)
    for row in rows:
        for value in row.values():
            assert not value.startswith(("=", "+", "@"))
            assert not value.startswith("-") or value.lstrip("-").replace(".", "").isdigit() or "e-" in value
    assert all(float(row["success_rate"]) >= 0 for row in rows)  # numbers stay numbers
    page = (tmp_path / "x" / "report" / "index.html").read_text()
    assert "<script>alert(1)" not in page


@pytest.mark.parametrize("name", ["x" * 20_000, "a\x1b[31mb", "two\nlines", "\u202eabc", ""])
def test_a_name_that_is_none_keeps_the_run_out(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, _ = synthetic.write_experiment(tmp_path / "x", algorithms=("ppo", "pid"), seeds=(0,), episodes=8)
    config = yaml.safe_load((run / "config.yaml").read_text())
    config["algo"]["name"] = name
    (run / "config.yaml").write_text(yaml.safe_dump(config))
    assert cli.main(["report", str(tmp_path / "x"), "--no-figures"]) == 0
    captured = capsys.readouterr()
    assert "\x1b" not in captured.out + captured.err
    report = (tmp_path / "x" / "report" / "report.md").read_text()
    assert "algo.name" in report.replace("\\", "")
    assert len(report) < 20_000


def test_long_values_stay_apart_in_labels() -> None:
    long = "x" * 20_000
    shown = {part("agent.note", long + end) for end in "ab"}
    assert len(shown) == 2
    assert max(map(len, shown)) < 100
    made = labels([{"algo": "ppo", "note": long + "a"}, {"algo": "ppo", "note": long + "b"}], [True, True])
    assert len(set(made)) == 2


def test_dollars_in_figures_are_letters() -> None:
    with style.styled():
        assert mpl.rcParams["text.parse_math"] is False
        figure: Figure = style.canvas(2, 2)
        text = figure.text(0, 0, r"$\undefined{$")
        assert not text.get_parse_math()
        figure.draw_without_rendering()


def test_ray_does_not_report_to_its_makers(monkeypatch: pytest.MonkeyPatch) -> None:
    import os
    import sys
    import types

    from auvbench.integrations.cluster.ray import RayBackend
    from auvbench.integrations.cluster.spec import Ray

    seen: list[str | None] = []
    fake = types.ModuleType("ray")
    fake.is_initialized = lambda: False  # type: ignore[attr-defined]
    fake.init = lambda **_: seen.append(os.environ.get("RAY_USAGE_STATS_ENABLED"))  # type: ignore[attr-defined]
    fake.remote = lambda **_: lambda function: function  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "ray", fake)
    monkeypatch.delenv("RAY_USAGE_STATS_ENABLED", raising=False)
    RayBackend(Ray(name="ray", workers=0, address=None, cpus=1.0, memory=0))
    assert seen == ["0"]
