"""Vehicle sheets: every one loads, says what the sources say, and a wrong one is refused with file, key and rule."""

from importlib import resources

import numpy as np
import pytest
import yaml
from omegaconf import OmegaConf

from auvbench import cli
from auvbench.errors import VehicleError
from auvbench.vehicles import changes, reader
from auvbench.vehicles.reader import sheet_names
from auvbench.vehicles.sheet import load
from tests import configs

FOLDER = resources.files("auvbench.conf") / "vehicle"
BLUEROV2 = (FOLDER / "bluerov2.yaml").read_text(encoding="utf-8")
FIELDS = [
    "mass",
    "weight",
    "buoyancy",
    "center_of_gravity",
    "center_of_buoyancy",
    "inertia",
    "M",
    "M_A",
    "linear_damping",
    "quadratic_damping",
    "allocation",
    "command_limits",
    "force_limits",
]

# name: mass kg, net buoyancy N, thrusters' rank, number of actuators (section 1 to 4 of the sources' collection)
FACTS = {
    "bluerov2": (15.22, 4.5198, 5, 6),
    "bluerov2_realistic_inertia": (15.22, 4.5198, 5, 6),
    "bluerov2_gz_sim_8_11": (15.22, 4.5198, 5, 6),
    "bluerov2_gz_sim_8_12": (15.22, 4.5198, 5, 6),
    "bluerov2_wu2018": (11.5, 1.985, 5, 6),
    "bluerov2_vonbenzon2022": (13.5, -0.982, 5, 6),
    "bluerov2_heavy": (13.5, -0.982, 6, 8),
    "bluerov2_heavy_wu2018": (11.5, 1.985, 6, 8),
    "bluerov2_2026": (11.0, 1.96, 5, 6),
    "bluerov2_li2020": (11.0, 1.96, 5, 6),
    "bluerov2_viktornfa": (11.0, 1.96, 5, 6),
    "bluerov2_heavy_2026": (13.0, 1.96, 6, 8),
    "bolt": (25.305, 1.16159, 6, 8),
    "bolt_mansour2025": (25.305, 4.8069, 6, 8),
    "rexrov": (1862.87, 263.509, 6, 8),
    "lrauv": (148.367, 0.0, 1, 6),
}


def test_every_sheet_has_its_facts_here():
    assert set(FACTS) == set(sheet_names())


@pytest.mark.parametrize("family", ["bluerov2", "bluerov2_heavy"])
def test_models_of_one_vehicle_number_their_thrusters_alike(family):
    first, *others = (
        load(name) for name in FACTS if name.startswith("bluerov2") and FACTS[name][3] == FACTS[family][3]
    )
    assert others
    for other in others:
        assert other.actuators == first.actuators
        for mine, its in zip(first.allocation.T, other.allocation.T, strict=True):
            assert mine @ its > 0.99 * np.linalg.norm(mine) * np.linalg.norm(its)


@pytest.mark.parametrize("name", sheet_names())
def test_sheet(name):
    vehicle = load(name)
    mass, net, rank, actuators = FACTS[name]
    assert vehicle.name == name
    assert vehicle.mass == mass
    assert vehicle.buoyancy - vehicle.weight == pytest.approx(net, abs=1e-3)
    assert np.linalg.matrix_rank(vehicle.allocation) == rank
    assert len(vehicle.actuators) == actuators
    np.testing.assert_array_equal(vehicle.M, vehicle.M.T)
    assert np.linalg.eigvalsh(vehicle.M)[0] > 0
    np.testing.assert_allclose(vehicle.M @ vehicle.M_inverse, np.eye(6), atol=1e-9)
    assert np.all(vehicle.command_limits[:, 0] < vehicle.command_limits[:, 1])


@pytest.mark.parametrize("name", sheet_names())
def test_hydra_composes_the_same_vehicle(name):
    node = configs.composed(f"vehicle={name}").vehicle
    composed = load(OmegaConf.to_container(node, resolve=True))
    direct = load(name)
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(composed, field), getattr(direct, field), err_msg=field)
    assert composed.actuators == direct.actuators


def test_the_command_line_overrides_a_number():
    node = configs.composed(
        "vehicle.rigid_body.mass.value=16", "vehicle.actuators.thrusters.lag.value=0.1", "vehicle.frame=enu"
    ).vehicle
    vehicle = load(OmegaConf.to_container(node, resolve=True))
    assert vehicle.mass == 16.0
    assert vehicle.units[0].lag.order == 1
    np.testing.assert_allclose(vehicle.units[0].lag.discretise(0.1)[0], np.exp(-1.0))


def test_every_number_names_a_source():
    """No list or number outside of `value`, and a source beside each value."""

    def walk(node, path):
        if isinstance(node, dict):
            if "value" in node:
                assert "source" in node, path
                return
            for key, child in node.items():
                walk(child, f"{path}.{key}")
        else:
            assert node is None or isinstance(node, (str, bool)), path

    for name in sheet_names():
        sheet = yaml.safe_load((FOLDER / f"{name}.yaml").read_text(encoding="utf-8"))
        for part in ("environment", "rigid_body", "buoyancy", "hydrodynamics", "actuators"):
            walk(sheet.get(part, {}), f"{name}.{part}")


def test_allocation_of_bluerov2():
    expected = [
        [0.7071, 0.7071, 0.7071, 0.7071, 0, 0],
        [0.7071, -0.7071, -0.7071, 0.7071, 0, 0],
        [0, 0, 0, 0, 1, -1],
        [0.0513, -0.0513, -0.0513, 0.0513, -0.1105, -0.1105],
        [-0.0513, -0.0513, -0.0513, -0.0513, -0.0025, 0.0025],
        [0.1665, -0.1665, 0.175, -0.175, 0, 0],
    ]
    np.testing.assert_allclose(load("bluerov2").allocation, expected, atol=5e-5)


def test_allocation_of_rexrov():
    """The TAM of uuv_thruster_manager, recomputed from poses and angles."""
    expected = [
        [0.159743, 0.159743, -0.159742, -0.159742, 0.707107, 0.707107, -0.707107, -0.707107],
        [-0.213610, 0.213610, -0.213610, 0.213610, 0.707107, -0.707107, 0.707107, -0.707107],
        [0.963770, 0.963770, 0.963770, 0.963770, 0, 0, 0, 0],
        [0.435232, -0.435232, 0.435232, -0.435232, -0.091217, 0.091217, -0.091217, 0.091217],
        [0.943093, 0.943093, -0.943093, -0.943093, 0.091217, 0.091217, -0.091217, -0.091217],
        [0.136889, -0.136889, -0.136888, 0.136888, -0.648799, 0.648799, 0.648799, -0.648799],
    ]
    np.testing.assert_allclose(load("rexrov").allocation, expected, atol=2e-6)


def test_ned_sheets_are_turned():
    vehicle = load("bluerov2_heavy")
    # The paper's allocation, rows Fx .. Mz in NED/FRD.
    ned = np.diag([1, -1, -1, 1, -1, -1]) @ vehicle.allocation
    np.testing.assert_allclose(ned[2], [0, 0, 0, 0, -1, -1, -1, -1], atol=1e-12)
    np.testing.assert_allclose(ned[3, 4:], [-0.218, 0.2178, -0.2176, 0.218], atol=1e-12)
    np.testing.assert_allclose(ned[5, :4], [-0.1888, 0.1887, 0.1886, -0.1888], atol=1e-4)
    assert vehicle.center_of_buoyancy[2] == 0.01  # above the centre of gravity


def test_only_sources_in_use_are_cited():
    assert "ideal" in dict(load("bluerov2").sources)
    assert "einarsson2020" not in dict(load("bluerov2_heavy").sources)


def test_inherited_sheet_overrides_one_value(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("defaults: [bluerov2, _self_]\nname: mine\nrigid_body:\n  mass: {value: 16.0}\n")
    vehicle = load(path)
    assert vehicle.mass == 16.0
    assert vehicle.weight == 16.0 * 9.8
    assert vehicle.actuators == load("bluerov2").actuators


INERTIA = "value: [[5.2539, 0.0144, 0.3341], [0.0144, 7.9420, 0.0260], [0.3341, 0.0260, 6.9123]]"
DIRECTION = "thruster1: [0.70710678, 0.70710678, 0.0]"
BROKEN = {
    "asymmetric inertia": (INERTIA, INERTIA.replace("[[5.2539, 0.0144", "[[5.2539, 0.9"), "not symmetric"),
    "indefinite inertia": (INERTIA, INERTIA.replace("6.9123", "-6.9123"), "not positive definite"),
    "no body's inertia": (INERTIA, "value: [1.0, 1.0, 10.0]", "each must be at most the sum of the other two"),
    "far from symmetric": (
        "  added_mass:\n    value: [5.5, 12.7, 14.57, 0.12, 0.12, 0.12]",
        "  symmetrise: true\n  added_mass:\n    value: [[9, 0, 0, 0, 0, 0], [0, 9, 0, 0, 0, 0], [0, 0, 9, 0, 0, 5], "
        "[0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1]]",
        r"entries \(3,6\) = 5 and \(6,3\) = 0 differ too much",
    ),
    "a release that is not known": (
        "hydrodynamics:\n",
        "hydrodynamics:\n  added_mass_coriolis: gz-sim-8.13\n",
        "added_mass_coriolis.*'gz-sim-8.13' must be true, false or gz-sim-8.11 or gz-sim-8.12",
    ),
    "a plugin's term of a full matrix": (
        "  added_mass:\n    value: [5.5, 12.7, 14.57, 0.12, 0.12, 0.12]",
        "  added_mass_coriolis: gz-sim-8.12\n  added_mass:\n    value: [[9, 1, 0, 0, 0, 0], [1, 9, 0, 0, 0, 0], "
        "[0, 0, 9, 0, 0, 0], [0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1]]",
        "gz-sim-8.12: the plugin's term needs a diagonal added mass",
    ),
    "indefinite added mass": ("value: [5.5, 12.7", "value: [-55.5, 12.7", "indefinite"),
    "asymmetric added mass": (
        "value: [5.5, 12.7, 14.57, 0.12, 0.12, 0.12]",
        "value: [[9, 1, 0, 0, 0, 0], [0, 9, 0, 0, 0, 0], [0, 0, 9, 0, 0, 0], [0, 0, 0, 1, 0, 0], "
        "[0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1]]",
        "not symmetric .*symmetrise",
    ),
    "negative mass": ("value: 15.22", "value: -3", "-3 kg is out of range: it must be greater than 0"),
    "negative damping": ("value: [25.15, 7.364", "value: [25.15, -7.364", "negative damping -7.364 in sway"),
    "not finite": ("value: 15.22", "value: .nan", "not finite"),
    "no number": ("value: 15.22", "value: heavy", "'heavy' is not a number"),
    "wrong shape": ("value: [0.0, 0.0, -0.1142]", "value: [0.0, -0.1142]", "wrong shape: expected 3"),
    "wrong unit": ("{value: 15.22, unit: kg", "{value: 15.22, unit: lb", "'lb' is not the unit"),
    "unknown key": ("  mass: {value", "  mas: {value", "unknown key; did you mean 'mass'"),
    "missing source": ("{value: 15.22, unit: kg, source: centrale}", "{value: 15.22, unit: kg}", "must name its source"),
    "unlisted source": ("unit: kg, source: centrale", "unit: kg, source: centrall", "did you mean 'centrale'"),
    "direction": (DIRECTION, "thruster1: [0.5, 0.5, 0.0]", "unit vector; this one has length 0.707"),
    "no limits": ("      limits: {value: [-40.0, 40.0], unit: N, source: centrale}\n", "", "thruster without limits"),
    "falling limits": ("value: [-40.0, 40.0]", "value: [40.0, -40.0]", "must be rising and enclose 0"),
    "negative lag": ("lag: {value: 0.0", "lag: {value: -0.1", "it must be at least 0"),
    "rank": ("heave, roll, yaw]", "heave, roll, pitch, yaw]", "rank-deficient allocation: .* span 5 of the 6"),
    "frame": ("\nframe: enu", "\nframe: nwu", "'nwu' is not known; .*enu"),
    "thrusters differ": ("        thruster6: [0.0025, 0.1105, -0.005]\n", "", "same thrusters"),
    "unknown type": ("type: thruster", "type: truster", "did you mean 'thruster'"),
    "remarks": ("\nframe: enu", "\nremarks: 1.0e+16\nframe: enu", "expected a list of texts, got 1e.16"),
    "twice": ("\nframe: enu", "\nframe: enu\nframe: ned", "not valid YAML: line 8: found duplicate key frame"),
    "yaml": ("name: bluerov2\n", "name: [bluerov2\n", "not valid YAML"),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_a_wrong_sheet_is_refused_with_file_and_rule(case, tmp_path):
    old, new, message = BROKEN[case]
    assert BLUEROV2.count(old) == 1, "the change must be unambiguous"
    path = tmp_path / "broken.yaml"
    path.write_text(BLUEROV2.replace(old, new))
    with pytest.raises(VehicleError, match=message) as raised:
        load(path)
    text = str(raised.value)
    assert "\n" not in text
    assert text.startswith(f"{path}: ")


def test_errors_without_a_file_name_the_key():
    sheet = yaml.safe_load(BLUEROV2)
    sheet["rigid_body"]["mass"]["value"] = 0
    with pytest.raises(VehicleError, match=r"^vehicle bluerov2: rigid_body\.mass\.value: 0 kg"):
        load(sheet)


def test_null_removes_an_inherited_key(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("defaults: [rexrov, _self_]\nname: mine\nactuators: {thrusters: {lag: null}}\n")
    assert load(path).units[0].lag.order == 0
    assert load("rexrov").units[0].lag.order == 1


def test_sheets_of_the_working_directory_are_known(tmp_path, monkeypatch):
    folder = tmp_path / "conf" / "vehicle"
    folder.mkdir(parents=True)
    (folder / "mine.yaml").write_text("defaults: [rexrov, _self_]\nname: mine\n")
    monkeypatch.chdir(tmp_path)
    assert {"mine", "rexrov"} <= set(sheet_names())
    assert load("mine").mass == load("rexrov").mass


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("bluerov", "vehicle 'bluerov' is not known; did you mean 'bluerov2'"),
        ("nowhere/bluerov2.yaml", "does not exist"),
    ],
)
def test_unknown_names(name, message):
    with pytest.raises(VehicleError, match=message):
        load(name)


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ("[11.5, 12.0]", r"rigid_body\.mass\.range: \[11\.5, 12\.0\] does not contain the value 11\.0"),
        ("[10.0]", r"rigid_body\.mass\.range: \[10\.0\] has the wrong shape: expected 2"),
        ("[low, 12.0]", "is not a number"),
    ],
)
def test_a_range_contains_its_value(written, message, tmp_path):
    content = reader.read("bluerov2_2026").data
    content["rigid_body"]["mass"]["range"] = yaml.safe_load(written)
    with pytest.raises(VehicleError, match=message):
        load(content)


RECOMMENDED = ["bluerov2_2026", "bluerov2_heavy_2026"]


@pytest.mark.parametrize("key", ["positions", "directions", "curve"])
def test_a_range_that_nothing_checks_is_refused(key):
    content = reader.read("bluerov2_2026").data
    content["actuators"]["thrusters"][key]["range"] = [0.0, 1.0]
    with pytest.raises(VehicleError, match=rf"actuators\.thrusters\.{key}\.range: unknown key"):
        load(content)


@pytest.mark.parametrize("name", RECOMMENDED)
@pytest.mark.parametrize("factor", [0.5, 1.5])
@pytest.mark.parametrize("number", changes.SCALES)
def test_a_sealed_protocol_may_scale_any_number_of_the_recommended_sheets(number, factor, name):
    content = reader.read(name).data
    changed = changes.changed(content, changes.Changes(scale={number: factor}))
    assert load(changed).name == name
    assert load(changed).M.tolist() != load(content).M.tolist() or number not in (
        "mass",
        "inertia",
        "added_mass",
    )


@pytest.mark.parametrize(
    "change",
    [
        ("rigid_body", "inertia", [[0.2, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.2]]),
        ("hydrodynamics", "added_mass", np.diag([5.5, 12.7, 14.57, 0.12, 0.12, 0.222]).tolist()),
    ],
)
def test_a_matrix_with_a_range_is_shown_in_one_row(change, tmp_path, capsys):
    section, key, value = change
    content = reader.read("bluerov2_2026").data
    content[section][key] |= {"value": value, "range": [value, value]}
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(content))
    assert cli.main(["vehicles", str(path)]) == 0
    assert f"{len(value)} x {len(value)} matrix" in capsys.readouterr().out


@pytest.mark.parametrize("name", RECOMMENDED)
def test_each_number_of_the_recommended_sheets_is_shown_with_its_sources(name, capsys):
    assert cli.main(["vehicles", name]) == 0
    shown = capsys.readouterr().out
    vehicle = load(name)
    quantities = reader.quantities(reader.read(name).data)
    assert {".".join(quantity.path) for quantity in quantities} >= {
        "rigid_body.mass", "buoyancy.net", "hydrodynamics.added_mass", "actuators.thrusters.lag"
    }  # fmt: skip
    for quantity in quantities:
        assert ".".join(quantity.path) in shown
        assert set(quantity.sources) <= {key for key, _ in vehicle.sources}
