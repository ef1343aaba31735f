"""The files that `auvbench vehicles NAME --sdf` writes, in a Gazebo that knows nothing of auvbench."""

import time

import numpy as np
import pytest

from auvbench.cli import main
from auvbench.simulators.fossen import FossenSimulator
from auvbench.simulators.gazebo import bindings
from auvbench.vehicles.sheet import load

absent = bindings.missing()
pytestmark = [
    pytest.mark.gazebo,
    pytest.mark.slow,
    pytest.mark.skipif(absent is not None, reason=f"Gazebo is not here: {absent}"),
]

NEWTONS = (10.0, 8.0, 10.0, 8.0, 4.0, -4.0)


@pytest.mark.parametrize("hydrodynamics", ["corrected", "published"])
def test_thruster_messages_move_it_as_the_embedded_simulator(tmp_path, hydrodynamics):
    assert main(["vehicles", "bluerov2", "--sdf", str(tmp_path), "--hydrodynamics", hydrodynamics]) == 0
    gazebo = bindings.load()
    from gz.msgs10.double_pb2 import Double
    from gz.msgs10.odometry_pb2 import Odometry
    from gz.msgs10.pose_pb2 import Pose

    world = (
        (tmp_path / "bluerov2.world.sdf").read_text().replace("<real_time_factor>1<", "<real_time_factor>0<")
    )
    (tmp_path / "fast.sdf").write_text(world)
    fixture = gazebo.sim.TestFixture(str(tmp_path / "fast.sdf"))
    seen = []

    def after(info, ecm):
        if info.iterations != 6000:
            return
        found = gazebo.sim.World(gazebo.sim.world_entity(ecm)).model_by_name(ecm, "bluerov2")
        pose = gazebo.sim.Link(gazebo.sim.Model(found).link_by_name(ecm, "base_link")).world_pose(ecm)
        seen.append([pose.pos().x(), pose.pos().y(), pose.pos().z()])

    fixture.on_post_update(after)
    fixture.finalize()
    node = gazebo.transport.Node()
    publishers = [node.advertise(f"/bluerov2/thruster{i + 1}/cmd", Double) for i in range(6)]
    for publisher, newtons in zip(publishers, NEWTONS, strict=True):
        publisher.publish(Double(data=newtons))
    heard = {"/model/bluerov2/pose": [], "/model/bluerov2/odometry": []}
    node.subscribe(Pose, "/model/bluerov2/pose", heard["/model/bluerov2/pose"].append)
    node.subscribe(Odometry, "/model/bluerov2/odometry", heard["/model/bluerov2/odometry"].append)
    time.sleep(1.0)  # messages come by threads of their own
    fixture.server().run(True, 6000, False)
    time.sleep(1.0)
    last = heard["/model/bluerov2/pose"][-1]
    assert last.name == "bluerov2"
    at = heard["/model/bluerov2/odometry"][-1].pose.position
    for position in (last.position, at):
        assert np.linalg.norm(np.array([position.x, position.y, position.z]) - seen[0]) < 0.05

    vehicle = load("bluerov2")
    simulator = FossenSimulator(vehicle, 1, max_step=0.001)
    if hydrodynamics == "published":
        from auvbench.dynamics.layout import CORIOLIS, LANES, PARAMETERS

        first = (CORIOLIS - PARAMETERS) * LANES
        simulator._parameters[:, first : first + 6 * LANES] *= -1.0
    simulator.step(vehicle.action(np.array([NEWTONS])), 6.0)
    way = np.linalg.norm(simulator.pose[0, :3])
    assert way > 2.0
    assert np.linalg.norm(np.array(seen[0]) - simulator.pose[0, :3]) < 0.01 * way
