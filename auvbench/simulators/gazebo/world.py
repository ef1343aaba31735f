"""A Gazebo world in this process: bodies that come and go while time stands still, and are pushed while it runs.

Read against gz-sim 8.14.0. What its Python bindings leave to do in another way than one would think:

* A body's velocity can be set, but not let go again (`Link.set_linear_velocity` holds it from then on), and a
  world's reset loses the Buoyancy system (gz-sim#3333). So a body is reset by removing it and creating another.
* Removing and creating are requests to the UserCommands system, which carries them out in iterations that may be
  paused ones. `Server.run(blocking, k, paused)` started paused goes on until a request ends the pause, and counts
  only what comes after: so bodies are exchanged between two physics steps of all others.
* A request to a service of the same process is answered within the call, so that nothing depends on timing.
"""

from __future__ import annotations

import itertools
import os
import signal
import tempfile
import threading
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.frames import rotation
from auvbench.dynamics.rigid_body import coriolis
from auvbench.errors import AuvbenchError
from auvbench.simulators.gazebo import bindings
from auvbench.simulators.gazebo.parts import LINK

FloatArray = NDArray[np.float64]

_NUMBERS = itertools.count()

_PATIENCE = 1000
"""paused iterations within which bodies must have come; a handful is usual"""


class GazeboError(AuvbenchError):
    """Gazebo did not do what it was asked for."""


@dataclass(frozen=True, slots=True)
class Drift:
    """What a current v_c adds to the forces that Gazebo computes from the velocity over ground.

    Damping and the inertia of added mass act on nu_r = nu - R^T v_c, whose derivative is nu' + omega x R^T v_c. With
    `<fluid_added_mass>` DART computes M_A nu' + C_A(nu) nu, and the Hydrodynamics plugin D(nu) nu; the difference to
    Fossen's M_A nu_r' + C_A(nu_r) nu_r + D(nu_r) nu_r is a force that is added to the thrusters'. (The plugin's own
    `<default_current>` leaves out M_A (omega x R^T v_c).)
    """

    M_A: FloatArray
    """(6, 6)"""
    linear: FloatArray
    """(6,) N s/m, N m s"""
    quadratic: FloatArray
    """(6,) N s2/m2, N m s2"""

    def wrench(self, current: FloatArray, R: FloatArray, nu: FloatArray) -> FloatArray:
        """(6,) in body axes.

        Args:
            current: (3,) m/s, world axes.
            R: (3, 3) rotation body to world.
            nu: (6,) velocity over ground, body axes.
        """
        v_c = R.T @ current
        nu_r = nu.copy()
        nu_r[:3] -= v_c
        swept = np.concatenate([np.cross(nu[3:], v_c), np.zeros(3)])
        return np.asarray(self._resistance(nu) - self._resistance(nu_r) - self.M_A @ swept)

    def _resistance(self, nu: FloatArray) -> FloatArray:
        """C_A(nu) nu + D(nu) nu."""
        return np.asarray(coriolis(self.M_A, nu) @ nu + (self.linear + self.quadratic * np.abs(nu)) * nu)


@dataclass(frozen=True, slots=True)
class Newcomer:
    """A body that is to take the place of another."""

    index: int
    model: str
    """a `<model>` element whose name `{name}` is filled in"""
    pose: FloatArray
    """(7,) x y z qw qx qy qz"""
    drift: Drift | None = None
    """what a current does to it, where the plugin is not told of one"""


class World:
    """N places for bodies in one world.

    Args:
        text: gives the SDF file of the empty world for its name; no two in a process share one, since a request to
            a service would reach either.
        n: number of places.
        step: s, the physics step that `text` states.
    """

    def __init__(self, text: Callable[[str], str], n: int, step: float) -> None:
        self.gazebo = bindings.load()
        self.n = n
        self.step = step
        self.pose: FloatArray = np.zeros((n, 7))
        self.velocity: FloatArray = np.zeros((n, 6))
        """(n, 6) of the body origin over ground, body axes"""
        self.current: FloatArray = np.zeros((n, 8))
        """(n, 8) velocity at the top (3) in m/s, difference to the bottom (3), z of the top in m, 1 / thickness"""
        self._names: list[str | None] = [None] * n
        self._links: list[Any] = [None] * n
        self._drifts: list[Drift | None] = [None] * n
        self._born = 0
        self._arriving: set[int] = set()
        self._patience = 0
        self._wrench: FloatArray = np.zeros((0, n, 6))
        self._k = 0
        self._error: BaseException | None = None
        self._name = f"auvbench{next(_NUMBERS)}"
        self._fixture = self._start(text(self._name))
        self._server = self._fixture.server()
        self._node = self.gazebo.transport.Node()

    def _start(self, text: str) -> Any:
        with tempfile.TemporaryDirectory(prefix="auvbench-gazebo-") as folder:
            path = Path(folder) / "world.sdf"
            path.write_text(text, encoding="utf-8")
            handlers = _handlers()
            fixture = self.gazebo.sim.TestFixture(str(path))
            # Gazebo keeps what it calls: through a reference of its own the world would never go.
            before, after = weakref.WeakMethod(self._before), weakref.WeakMethod(self._after)
            fixture.on_pre_update(lambda info, ecm: before()(info, ecm))  # type: ignore[misc]
            fixture.on_post_update(lambda info, ecm: after()(info, ecm))  # type: ignore[misc]
            fixture.finalize()
            # Gazebo's server stops on SIGINT and SIGTERM by itself; here it is the run that saves and stops.
            for number, handler in handlers.items():
                signal.signal(number, handler)
        return fixture

    def set_step(self, step: float) -> None:
        """Another physics step in s, from the next `advance` on, which must bring a newcomer or follow one."""
        request = self.gazebo.physics(max_step_size=step, real_time_factor=0.0)
        self._ask("set_physics", request)
        self.step = step
        self._arriving.add(-1)

    def advance(self, newcomers: Sequence[Newcomer], wrench: FloatArray) -> None:
        """Exchanges bodies while time stands still, then makes a physics step for each row of `wrench`.

        Args:
            newcomers: bodies that take their places first.
            wrench: (steps, n, 6) N and N m in body axes, at the body origin.

        Raises:
            GazeboError: a body did not come, or Gazebo refused a request.
        """
        if newcomers:
            self._exchange(newcomers)
        self._wrench, self._k, self._patience = wrench, 0, 0
        self._server.run(True, len(wrench), bool(self._arriving))
        self._arriving.clear()
        if self._error is not None:
            error, self._error = self._error, None
            raise error
        if self._k != len(wrench):
            raise GazeboError(f"Gazebo made {self._k} of {len(wrench)} physics steps: was it stopped?")

    def _exchange(self, newcomers: Sequence[Newcomer]) -> None:
        create = self.gazebo.entity_factories()
        for newcomer in newcomers:
            old = self._names[newcomer.index]
            if old is not None:
                self._ask("remove", self.gazebo.entity(name=old, type=self.gazebo.entity.MODEL))
            # A name of its own for each: the old body is still there while the new one is made.
            name = f"body{newcomer.index}-{self._born}"
            self._born += 1
            self._names[newcomer.index] = name
            entry = create.data.add()
            entry.sdf = f'<?xml version="1.0"?><sdf version="1.11">{newcomer.model.format(name=name)}</sdf>'
            entry.name = name
            position, turn = entry.pose.position, entry.pose.orientation
            position.x, position.y, position.z = newcomer.pose[:3].tolist()
            turn.w, turn.x, turn.y, turn.z = newcomer.pose[3:].tolist()
            self._arriving.add(newcomer.index)
            self._links[newcomer.index] = None
            self._drifts[newcomer.index] = newcomer.drift
        self._ask("create_multiple", create)

    def _ask(self, service: str, request: Any) -> None:
        done, answer = self._node.request(
            f"/world/{self._name}/{service}", request, type(request), self.gazebo.boolean, 5000
        )
        if not (done and answer.data):
            raise GazeboError(f"Gazebo refused a request to its service /world/{self._name}/{service}")

    # Gazebo calls these two in every iteration. What they raise would be lost in it: it is kept for `advance`.

    def _before(self, info: Any, ecm: Any) -> None:
        if self._error is not None:
            if info.paused:
                self._go()  # to the end of what was begun: only then does Gazebo give control back
            return
        try:
            if info.paused:
                self._settle(ecm)
            elif self._k < len(self._wrench):
                self._push(ecm)
        except BaseException as error:
            self._error = error

    def _after(self, info: Any, ecm: Any) -> None:
        if info.paused or self._error is not None:
            return
        self._k += 1
        try:
            if self._k == len(self._wrench):
                self._read(ecm)
        except BaseException as error:
            self._error = error

    def _settle(self, ecm: Any) -> None:
        """One paused iteration: looks whether all bodies have come, and ends the pause one iteration later."""
        sim = self.gazebo.sim
        self._patience += 1
        if self._patience > _PATIENCE:
            missing = sorted(i for i in self._arriving if i >= 0)
            raise GazeboError(f"Gazebo did not create the bodies {missing}: its own messages say why")
        self._arriving.discard(-1)
        if not self._arriving:
            self._go()
            return
        world = sim.World(sim.world_entity(ecm))
        for index in list(self._arriving):
            entity = world.model_by_name(ecm, self._names[index])
            if entity == sim.K_NULL_ENTITY:
                continue
            link = sim.Link(sim.Model(entity).link_by_name(ecm, LINK))
            if not link.valid(ecm):
                continue
            link.enable_velocity_checks(ecm)
            self._links[index] = link
            self._arriving.discard(index)

    def _go(self) -> None:
        self._ask("control", self.gazebo.world_control(pause=False))

    def _push(self, ecm: Any) -> None:
        vector = self.gazebo.math.Vector3d
        for i, row in enumerate(self._wrench[self._k].tolist()):
            link, drift = self._links[i], self._drifts[i]
            pose = link.world_pose(ecm)
            turn = pose.rot()
            if drift is not None and self.current[i, :6].any():
                current = self.current[i]
                share = min(max((current[6] - pose.pos().z()) * current[7], 0.0), 1.0)
                water = current[:3] + share * current[3:6]
                row = (drift.wrench(water, rotation(_four(turn)), _twist(link, turn, ecm)) + row).tolist()
            force = turn.rotate_vector(vector(row[0], row[1], row[2]))
            torque = turn.rotate_vector(vector(row[3], row[4], row[5]))
            link.add_world_wrench(ecm, force, torque)

    def _read(self, ecm: Any) -> None:
        for i, link in enumerate(self._links):
            pose = link.world_pose(ecm)
            at, turn = pose.pos(), pose.rot()
            self.pose[i, :3] = at.x(), at.y(), at.z()
            self.pose[i, 3:] = _four(turn)
            self.velocity[i] = _twist(link, turn, ecm)


def _four(turn: Any) -> FloatArray:
    """Quaternion (4,) w x y z."""
    return np.array([turn.w(), turn.x(), turn.y(), turn.z()])


def _twist(link: Any, turn: Any, ecm: Any) -> FloatArray:
    """Velocity (6,) over ground of the link's origin, body axes."""
    v = turn.rotate_vector_reverse(link.world_linear_velocity(ecm))
    w = turn.rotate_vector_reverse(link.world_angular_velocity(ecm))
    return np.array([v.x(), v.y(), v.z(), w.x(), w.y(), w.z()])


def _handlers() -> dict[int, Any]:
    """The handlers of the signals that Gazebo takes over; none outside the main thread, which cannot set them."""
    if threading.current_thread() is not threading.main_thread() or os.name != "posix":
        return {}
    return {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
