"""SDF from a sheet: the same body, the same water, the same thrusters, and a refusal where Gazebo has no such thing."""

import ast
import dataclasses
import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import yaml

from auvbench.cli import main
from auvbench.errors import VehicleError
from auvbench.integrations.gazebo import parts, sdf
from auvbench.vehicles.sheet import load

THRUSTERS_ONLY = (
    "bluerov2",
    "bluerov2_heavy",
    "bluerov2_heavy_wu2018",
    "bluerov2_realistic_inertia",
    "bluerov2_wu2018",
    "rexrov",
)


def parsed(vehicle, hydrodynamics="corrected", **options):
    return ET.fromstring(sdf.model(vehicle, hydrodynamics, **options))


def vector(element, path):
    return np.array([float(word) for word in element.findtext(path).split()])


def body(link):
    """Mass, moment and inertia about the model's origin of a link, the latter without rotation of its frame."""
    mass = float(link.findtext("inertial/mass"))
    at = vector(link, "pose")[:3] if link.find("pose") is not None else np.zeros(3)
    r = at + (vector(link, "inertial/pose")[:3] if link.find("inertial/pose") is not None else np.zeros(3))
    inertia = np.zeros((3, 3))
    for i, a in enumerate("xyz"):
        for j, b in enumerate("xyz"):
            key = f"i{min(a, b)}{max(a, b)}"
            inertia[i, j] = float(link.findtext(f"inertial/inertia/{key}", "0"))
    return mass, mass * r, inertia + mass * (r @ r * np.eye(3) - np.outer(r, r))


def content(element):
    return [(part.tag, part.attrib, (part.text or "").strip()) for part in element.iter()]


def plugin(element, name):
    found = [p for p in element.findall("plugin") if p.get("name") == f"gz::sim::systems::{name}"]
    assert found
    return found


@pytest.mark.parametrize("name", THRUSTERS_ONLY)
@pytest.mark.parametrize("thrusters", [True, False])
def test_the_links_together_are_the_body_of_the_sheet(name, thrusters):
    vehicle = load(name)
    links = [body(link) for link in parsed(vehicle, thrusters=thrusters).findall("link")]
    assert len(links) == (1 + len(vehicle.units) if thrusters else 1)
    M = vehicle.M_RB
    assert sum(mass for mass, _, _ in links) == pytest.approx(vehicle.mass, rel=1e-14)
    moment = sum(moment for _, moment, _ in links)
    np.testing.assert_allclose(moment, vehicle.mass * vehicle.center_of_gravity, atol=1e-12)
    np.testing.assert_allclose(sum(inertia for _, _, inertia in links), M[3:, 3:], rtol=1e-12, atol=1e-12)
    hull = np.linalg.eigvalsh(links[0][2])
    assert hull[0] > 0.0


@pytest.mark.parametrize("name", THRUSTERS_ONLY)
def test_added_mass_damping_and_buoyancy_are_the_sheets(name):
    vehicle = load(name)
    model = parsed(vehicle)
    link = model.find("link")
    added = link.find("inertial/fluid_added_mass")
    M_A = np.zeros((6, 6))
    for i, a in enumerate("xyzpqr"):
        for j, b in enumerate("xyzpqr"):
            if j >= i:
                M_A[i, j] = M_A[j, i] = float(added.findtext(a + b))
    assert np.array_equal(M_A, vehicle.M_A)
    tags = plugin(model, "Hydrodynamics")[0]
    linear = [float(tags.findtext(tag, "0")) for tag in ("xU", "yV", "zW", "kP", "mQ", "nR")]
    assert np.array_equal(linear, -vehicle.linear_damping)
    quadratic = [
        float(tags.findtext(tag, "0")) for tag in ("xUabsU", "yVabsV", "zWabsW", "kPabsP", "mQabsQ", "nRabsR")
    ]
    assert np.array_equal(quadratic, -vehicle.quadratic_damping)
    assert not [tag for tag in tags if "Dot" in tag.tag]  # or DART and the plugin would both add it
    radius = float(link.findtext("collision/geometry/sphere/radius"))
    lift = 4.0 / 3.0 * math.pi * radius**3 * vehicle.density * vehicle.gravity
    assert lift == pytest.approx(vehicle.buoyancy, rel=1e-14)
    assert np.array_equal(vector(link, "collision/pose")[:3], vehicle.center_of_buoyancy)
    assert link.findtext("collision/surface/contact/collide_bitmask") == "0"


def test_thrusters_push_where_and_as_hard_as_the_sheet_says():
    vehicle = load("bluerov2")
    model = parsed(vehicle)
    links = {link.get("name"): link for link in model.findall("link")}
    joints = {joint.get("name"): joint for joint in model.findall("joint")}
    for unit, tags in zip(vehicle.units, plugin(model, "Thruster"), strict=True):
        joint = joints[tags.findtext("joint_name")]
        assert np.array_equal(vector(links[joint.findtext("child")], "pose")[:3], unit.position)
        assert np.array_equal(vector(joint, "axis/xyz"), unit.direction)
        assert (float(tags.findtext("min_thrust_cmd")), float(tags.findtext("max_thrust_cmd"))) == (-40, 40)
        assert f"{tags.findtext('namespace')}/{tags.findtext('topic')}" == f"bluerov2/{unit.name}/cmd"


def test_published_gives_added_mass_to_the_plugin_and_none_to_dart():
    vehicle = load("bluerov2")
    model = parsed(vehicle, "published")
    assert model.find("link/inertial/fluid_added_mass") is None
    tags = plugin(model, "Hydrodynamics")[0]
    names = ("xDotU", "yDotV", "zDotW", "kDotP", "mDotQ", "nDotR")
    assert [float(tags.findtext(name)) for name in names] == (-np.diag(vehicle.M_A)).tolist()
    assert tags.find("disable_coriolis") is None
    still = dataclasses.replace(vehicle, added_mass_coriolis=False)
    assert plugin(parsed(still, "published"), "Hydrodynamics")[0].findtext("disable_coriolis") == "true"


@pytest.mark.parametrize(
    ("name", "hydrodynamics", "words"),
    [
        ("lrauv", "corrected", "rudder is a fin"),
        ("bluerov2_heavy", "published", r"largest eigenvalue of M_RB\^-1 M_A is 1.38"),
        ("bluerov2_gz_sim_8_12", "corrected", r"is a copy of Gazebo's plugin \(gz-sim-8.12\)"),
        (
            "bluerov2_gz_sim_8_11",
            "published",
            "original vehicle with simulator.hydrodynamics=published",
        ),
    ],
)
def test_what_gazebo_cannot_be_is_refused(name, hydrodynamics, words):
    with pytest.raises(VehicleError, match=words):
        sdf.model(load(name), hydrodynamics)


def test_a_weight_of_its_own_and_a_missing_coriolis_term_are_refused():
    vehicle = load("bluerov2")
    with pytest.raises(VehicleError, match="is not mass x gravity"):
        sdf.check_vehicle(dataclasses.replace(vehicle, weight=150.0), "corrected")
    with pytest.raises(VehicleError, match="use hydrodynamics=published"):
        sdf.check_vehicle(dataclasses.replace(vehicle, added_mass_coriolis=False), "corrected")


def test_a_current_and_a_name_are_written_where_they_belong():
    model = parsed(load("bluerov2"), name="b7", current=np.array([0.25, -0.5, 0.0]), thrusters=False)
    assert model.get("name") == "b7"
    assert plugin(model, "Hydrodynamics")[0].findtext("default_current") == "0.25 -0.5 0"
    assert not [p for p in model.findall("plugin") if "Thruster" in p.get("name")]


@pytest.mark.parametrize("value", [0.1, 1e-300, -0.0, 3.0, 1 / 3, 5.2529371678464365, 1e22])
def test_numbers_read_back_as_the_same_double(value):
    assert float(parts.number(value)) == value


def test_the_files_parse_and_name_their_sources(tmp_path):
    vehicle = load("bluerov2")
    paths = sdf.write(tmp_path, sdf.files(vehicle, "corrected", 0.002))
    assert [path.relative_to(tmp_path).as_posix() for path in paths] == [
        "bluerov2/model.config",
        "bluerov2/model.sdf",
        "bluerov2.world.sdf",
        "bluerov2.bridge.yaml",
        "bluerov2.launch.py",
    ]
    text = (tmp_path / "bluerov2.world.sdf").read_text()
    world = ET.fromstring(text).find("world")
    assert world.findtext("physics/max_step_size") == "0.002"
    assert world.findtext("gravity") == "0 0 -9.8"
    assert plugin(world, "Buoyancy")[0].findtext("uniform_fluid_density") == "1000"
    alone = ET.parse(tmp_path / "bluerov2" / "model.sdf").getroot().find("model")
    assert content(world.find("model")) == content(alone)
    for number in ("<mass>15.16</mass>", "<xU>-25.15</xU>", "<xUabsU>-33.8</xUabsU>"):
        assert number in text
    assert all(f"{key}: {parts.comment(citation)}" in text for key, citation in vehicle.sources)
    bridge = yaml.safe_load((tmp_path / "bluerov2.bridge.yaml").read_text())
    assert {
        "ros_topic_name": "/bluerov2/cmd_thruster6",
        "gz_topic_name": "/bluerov2/thruster6/cmd",
        "ros_type_name": "std_msgs/msg/Float64",
        "gz_type_name": "gz.msgs.Double",
        "direction": "ROS_TO_GZ",
    } in bridge
    assert len(bridge) == 6 + 4
    ast.parse((tmp_path / "bluerov2.launch.py").read_text())


def test_the_command_writes_and_refuses(tmp_path, capsys):
    assert main(["vehicles", "bluerov2", "--sdf", str(tmp_path / "out"), "--step", "0.01"]) == 0
    assert (tmp_path / "out" / "bluerov2.world.sdf").is_file()
    assert "gz sim -r -s" in capsys.readouterr().out
    for arguments, words in (
        (["bluerov2", "--hydrodynamics", "published"], "go with --sdf DIR"),
        (["--sdf", str(tmp_path)], "needs the name of a vehicle"),
        (["bluerov2", "--sdf", "/proc/nowhere"], "cannot be written"),
        (["bluerov2_heavy", "--sdf", str(tmp_path / "x"), "--hydrodynamics", "published"], "diverges"),
    ):
        assert main(["vehicles", *arguments]) == 2
        error = capsys.readouterr().err
        assert words in error
        assert error.count("\n") == 1
    assert not (tmp_path / "x").exists()
