"""What a client may ask of a server: a current that the motion survives, and steps that Ctrl-C ends."""

from types import SimpleNamespace

import numpy as np
import pytest

from auvbench.integrations.ros2 import vehicle_node
from auvbench.integrations.ros2.server import Server
from auvbench.integrations.ros2.vehicle_node import VehicleNode


def message(*water):
    return SimpleNamespace(**dict(zip("xyz", water, strict=True)))


@pytest.fixture
def server():
    """A server without a network."""
    server = Server.__new__(Server)
    server.currents = np.zeros((1, 8))
    server._refused = None
    server.applied = 0

    def apply():
        server.applied += 1

    server.apply_currents = apply
    return server


@pytest.mark.parametrize(
    "water", [(100.0, 0.0, 0.0), (0.0, -20.1, 0.0), (0.0, 0.0, np.nan), (np.inf, 0.0, 0.0)]
)
def test_a_current_out_of_range_is_ignored_and_reported_once(server, water, capsys):
    for _ in range(3):
        server._set_current(message(*water))
    assert server.applied == 0
    assert not server.currents.any()
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "-20 .. 20 m/s" in error


def test_a_current_in_range_is_set(server, capsys):
    server._set_current(message(0.5, -20.0, 0.0))
    assert server.currents[0, :6].tolist() == [0.5, -20.0, 0.0] * 2
    assert capsys.readouterr().err == ""


def test_the_parameter_has_the_same_range():
    assert vehicle_node.is_current([100.0, 0.0, 0.0]) == "one is 100.0"
    assert vehicle_node.is_current([0.0] * 6 + [0.0, 5000.0]) == ""
    assert vehicle_node.is_current([0.0] * 5 + [50.0, 0.0, 1.0]) == "one is 50.0"


def test_many_steps_end_when_the_server_is_asked_to():
    steps = []
    server = SimpleNamespace(
        settings=SimpleNamespace(steps=1_000_000),
        set_paused=lambda paused: None,
        advance=lambda: steps.append(1),
        goes_on=lambda: len(steps) < 3,
    )
    answer = VehicleNode._step(SimpleNamespace(server=server), None, SimpleNamespace())
    assert len(steps) == 3
    assert not answer.success
    assert answer.message == "the server stops after 3 of 1000000 steps"
