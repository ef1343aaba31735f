"""Sheets and pages of an identification, and the comparison of sheets with logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from auvbench.cli import main
from auvbench.errors import VehicleError
from auvbench.identification import parameters, sheets, validation
from auvbench.identification.fit import Fit
from auvbench.identification.log import CHANNELS, Log
from auvbench.vehicles import identified, reader, sheet
from tests.unit.identification.test_fit import NOISE, TRUTH, fitted, flown

NAMES = {"yaw": "yaw_rad", "r": "r_radps"}


def write(log: Log, path: Path) -> None:
    columns = {"t_s": log.time} | {f"{a}_cmd": log.inputs[:, k] for k, a in enumerate(log.actuators)}
    columns |= {NAMES[c]: log.measured[:, CHANNELS.index(c)] for c in NOISE}
    pd.DataFrame(columns).round(6).to_csv(path, index=False)


@pytest.fixture(scope="module")
def result() -> Fit:
    vehicle, log = flown(TRUTH, ["yaw"], 40.0)
    return fitted(vehicle, log, "added_mass.surge", *TRUTH)


@pytest.fixture(scope="module")
def content(result: Fit) -> dict[str, object]:
    base = reader.read("bluerov2_2026").data
    return sheets.identified_sheet(
        base, result, name="mine", command="auvbench identify a", digests=[("a", "f" * 64)]
    )


@pytest.mark.slow
def test_a_sheet_has_the_identified_numbers_with_interval_and_source(
    result: Fit, content: dict[str, object], tmp_path: Path
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(sheets.dump(content), encoding="utf-8")
    vehicle = sheet.load(file)
    assert vehicle.name == "mine"
    assert vehicle.M_A[5, 5] == pytest.approx(result.numbers["added_mass.yaw"], rel=1e-5)
    assert vehicle.M_A[0, 0] == 5.5  # Not identified.
    quantities = {".".join(q.path): q for q in reader.quantities(reader.read(file).data)}
    added = quantities["hydrodynamics.added_mass"]
    assert added.sources[0] == "identified"
    assert added.note == "identified: yaw; the range of these is the 95 % interval"
    assert added.range[0][5] < TRUTH["added_mass.yaw"] < added.range[1][5]
    assert "SHA-256 ffffffffffff" in dict(vehicle.sources)["identified"]
    section = identified.of(reader.read(file))
    assert section is not None
    assert section.parameters == ("added_mass.surge", *TRUTH)
    np.testing.assert_allclose(section.values(section.fitted), list(result.numbers.values()), rtol=1e-4)


@pytest.mark.slow
def test_vehicles_are_drawn_from_the_joint_covariance(result: Fit, content: dict[str, object]) -> None:
    section = identified.of(reader.read(content))
    assert section is not None
    draws = section.draws(4000, np.random.default_rng(0))
    linear, quadratic = (
        np.log([draw[f"{name}_damping.yaw"] for draw in draws]) for name in ("linear", "quadratic")
    )
    names = [e.parameter.name for e in result.estimates]
    i, j = names.index("linear_damping.yaw"), names.index("quadratic_damping.yaw")
    expected = result.covariance[i, j] / np.sqrt(result.covariance[i, i] * result.covariance[j, j])
    assert np.corrcoef(linear, quadratic)[0, 1] == pytest.approx(expected, abs=0.05)
    assert expected < -0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("covariance", [[1.0]], "identification.covariance: [[1.0]] has the wrong shape: expected 4x4"),
        ("covariance", (-np.eye(4)).tolist(), "must be symmetric without negative eigenvalues"),
        ("parameters", [], "expected a list of names"),
        ("logarithmic", [1, 2, 3, 4], "expected a list of 4 values, each true or false"),
        ("errors", {"r": {"soon": 1.0}}, "expected a horizon such as 0.5_s"),
        ("errors", 3, "expected a mapping of channels to their horizons"),
    ],
)
def test_a_wrong_section_is_refused(
    content: dict[str, object], key: str, value: object, message: str
) -> None:
    section = content["identification"]
    assert isinstance(section, dict)
    with pytest.raises(VehicleError) as raised:
        sheet.load({**content, "identification": {**section, key: value}})
    assert message in str(raised.value)


@pytest.mark.parametrize("name", ["rexrov", "bluerov2_vonbenzon2022", "bluerov2_heavy"])
def test_every_kind_of_number_is_written(name: str) -> None:
    vehicle = sheet.load(name)
    chosen = parameters.choose(vehicle, list(parameters.known(vehicle)), False)
    from auvbench.identification.fit import Estimate

    rng = np.random.default_rng(0)
    estimates = []
    for parameter in chosen:
        x = 0.2 * float(rng.standard_normal())
        estimates.append(Estimate(parameter, x, parameter.value(x - 0.1), parameter.value(x + 0.1), 0.05))
    values = {e.parameter.name: e.value for e in estimates}
    fake = object.__new__(Fit)
    for key, value in (
        ("vehicle", vehicle),
        ("logs", (flown({}, ["yaw"], 10.0)[1],)),
        ("estimates", tuple(estimates)),
        ("covariance", np.eye(len(estimates))),
    ):
        object.__setattr__(fake, key, value)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sheets, "quantiles", lambda *_: {"r": {0.5: 0.1}})
        found = sheet.load(
            sheets.identified_sheet(
                reader.read(name).data, fake, name="x", command="c", digests=[("a", "0" * 64)]
            )
        )
    wanted = parameters.with_values(vehicle, values)
    for field in (
        "mass",
        "weight",
        "buoyancy",
        "M_A",
        "inertia",
        "linear_damping",
        "quadratic_damping",
        "center_of_buoyancy",
    ):
        np.testing.assert_allclose(
            getattr(found, field), getattr(wanted, field), rtol=2e-4, atol=1e-5, err_msg=field
        )
    command = 0.5 * np.ones(len(vehicle.units))
    np.testing.assert_allclose(
        found.force(command), vehicle.force(command) * parameters.gains(vehicle, values), rtol=1e-4, atol=1e-6
    )


@pytest.mark.slow
def test_the_right_sheet_predicts_best_and_its_bands_cover(content: dict[str, object]) -> None:
    _, log = flown(TRUTH, ["yaw"], 60.0, seed=7)
    entries = [
        ("wrong", sheet.load("bluerov2_2026"), None),
        ("right", sheet.load(content), identified.of(reader.read(content))),
    ]
    done = validation.validate([log], entries)
    hold, constant, wrong, right = done.predictions
    assert done.skill(hold) == 1.0
    assert done.skill(right) < 0.5 * done.skill(wrong)
    assert wrong.coverage() is None
    covered = right.coverage()
    assert covered is not None
    assert 0.8 < covered < 0.97
    r, yaw = CHANNELS.index("r"), CHANNELS.index("yaw")
    second = validation.HORIZONS.index(1.0)
    # Holding the rate is constant velocity; for the angle it is not.
    assert hold.rms()[second, r] == constant.rms()[second, r]
    assert hold.rms()[second, yaw] != constant.rms()[second, yaw]
    assert np.isnan(hold.rms()[:, CHANNELS.index("x")]).all()


def test_rarely_measured_values_have_no_short_horizon() -> None:
    _, log = flown(TRUTH, ["yaw"], 30.0)
    log.measured[np.arange(len(log.time)) % 21 != 0] = np.nan  # every 0.42 s
    windows = validation.horizons([log])
    r = CHANNELS.index("r")
    assert np.isnan(windows.measured[:, 1, r]).all()
    assert np.isfinite(windows.measured[:, 2, r]).any()


def run(folder: Path) -> None:
    _, log = flown(TRUTH, ["yaw"], 40.0)
    write(log, folder / "train.csv")
    _, log = flown(TRUTH, ["yaw"], 30.0, seed=5)
    write(log, folder / "test.csv")


@pytest.mark.slow
def test_from_a_log_to_a_sheet_to_a_comparison(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run(tmp_path)
    monkeypatch.chdir(tmp_path)
    names = "parameters=added_mass,linear_damping.yaw,quadratic_damping.yaw"
    assert main(["identify", "train.csv", "vehicle=bluerov2_2026", "name=mine", names]) == 0
    out = capsys.readouterr().out
    assert "Next: Apply a telegraph signal in" in out
    folder = Path("outputs/identify/mine")
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert "numbers of bluerov2_2026 identified from 40 s" in page
    assert page.count("<figure") == 3
    Path("conf/vehicle").mkdir(parents=True)
    Path("conf/vehicle/mine.yaml").write_bytes((folder / "mine.yaml").read_bytes())
    section = yaml.safe_load((folder / "mine.yaml").read_text(encoding="utf-8"))["identification"]
    assert section["command"].startswith("auvbench identify train.csv")
    assert main(["validate", "test.csv", "vehicle=mine,bluerov2_2026"]) == 0
    out = capsys.readouterr().out
    best = next(line for line in out.splitlines() if line.startswith(("mine ", "bluerov2_2026 ")))
    assert best.startswith("mine ")
    page = Path("outputs/validate/index.html").read_text(encoding="utf-8")
    assert "mine predicts the logs best" in page
    assert main(["simulate", "vehicle=mine", "duration=1", "output=x.csv"]) == 0
