"""The files that `auvbench vehicles NAME --sdf` writes, in a Gazebo that knows nothing of auvbench."""

import numpy as np
import pytest

from auvbench.cli import main
from auvbench.integrations.gazebo import bindings
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.sheet import load
from tests.waiting import until

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
    topics = [f"/bluerov2/thruster{i + 1}/cmd" for i in range(6)]
    publishers = [node.advertise(topic, Double) for topic in topics]
    until(
        lambda: all(publisher.has_connections() for publisher in publishers), "the thrusters' subscriptions"
    )
    commands = {topic: [] for topic in topics}
    for topic in topics:
        node.subscribe(Double, topic, commands[topic].append)
    for publisher, newtons in zip(publishers, NEWTONS, strict=True):
        publisher.publish(Double(data=newtons))
    until(lambda: all(commands.values()), "the commands")
    heard = {"/model/bluerov2/pose": [], "/model/bluerov2/odometry": []}
    node.subscribe(Pose, "/model/bluerov2/pose", heard["/model/bluerov2/pose"].append)
    node.subscribe(Odometry, "/model/bluerov2/odometry", heard["/model/bluerov2/odometry"].append)
    fixture.server().run(True, 6000, False)

    def arrived():  # messages come by threads of their own
        if not all(heard.values()):
            return False
        at = heard["/model/bluerov2/pose"][-1].position, heard["/model/bluerov2/odometry"][-1].pose.position
        return all(np.linalg.norm(np.array([p.x, p.y, p.z]) - seen[0]) < 0.05 for p in at)

    until(arrived, "the last pose and odometry at the vehicle's place")
    assert heard["/model/bluerov2/pose"][-1].name == "bluerov2"

    vehicle = load("bluerov2")
    simulator = FossenSimulator(vehicle, 1, max_step=0.001)
    if hydrodynamics == "published":
        from auvbench.dynamics.layout import VEHICLE, side_by_side

        C_A = simulator._parameters.view(side_by_side(VEHICLE))["M_A_coriolis"]
        C_A["M11"] *= -1.0
        C_A["M22"] *= -1.0
    simulator.step(vehicle.action(np.array([NEWTONS])), 6.0)
    way = np.linalg.norm(simulator.pose[0, :3])
    assert way > 2.0
    assert np.linalg.norm(np.array(seen[0]) - simulator.pose[0, :3]) < 0.01 * way
