"""Run a Gazebo world in this process: exchange bodies while it is paused, and apply forces while it runs.

Written for gz-sim 8.14.0, whose Python bindings have three properties that shape this module:

* `Link.set_linear_velocity` keeps the velocity constant from then on, and a world's reset loses the Buoyancy
  system (gz-sim#3333). So a body is reset by removing it and creating another.
* The UserCommands system also removes and creates bodies in paused iterations. If `Server.run(blocking, k, paused)`
  starts paused, it iterates until a request ends the pause, and then makes k more iterations. So bodies are exchanged
  between two physics steps, while the other bodies do not move.
* A request to a service of the same process is answered within the call, so timing does not matter.
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
from auvbench.integrations.gazebo import bindings
from auvbench.integrations.gazebo.parts import LINK

FloatArray = NDArray[np.float64]

_NUMBERS = itertools.count()

_PATIENCE = 1000
"""largest number of paused iterations to wait for new bodies, which usually appear within ten iterations"""


class GazeboError(AuvbenchError):
    """Gazebo failed or refused a request."""


@dataclass(frozen=True, slots=True)
class CurrentForce:
    """Correction of Gazebo's hydrodynamic forces, which ignore the current, for a current v_c.

    Damping and the inertia of added mass act on nu_r = nu - R^T v_c, whose derivative is nu' + omega x R^T
    v_c. With `<fluid_added_mass>` DART computes M_A nu' + C_A(nu) nu, and the Hydrodynamics plugin computes
    D(nu) nu. The difference to Fossen's M_A nu_r' + C_A(nu_r) nu_r + D(nu_r) nu_r is added to the thrusters'
    force. (The plugin's own `<default_current>` omits M_A (omega x R^T v_c).)
    """

    M_A: FloatArray
    """(6, 6) added mass"""
    linear: FloatArray
    """(6,) linear damping, N s/m, N m s"""
    quadratic: FloatArray
    """(6,) quadratic damping, N s2/m2, N m s2"""

    def wrench(self, current: FloatArray, R: FloatArray, nu: FloatArray) -> FloatArray:
        """Return the correction, (6,): force in N and moment in N m, body axes.

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
        """Return C_A(nu) nu + D(nu) nu."""
        return np.asarray(coriolis(self.M_A, nu) @ nu + (self.linear + self.quadratic * np.abs(nu)) * nu)


@dataclass(frozen=True, slots=True)
class NewBody:
    """A body to create in one of a world's places, where it replaces an earlier body."""

    index: int
    model: str
    """`<model>` element with a placeholder `{name}`"""
    pose: FloatArray
    """(7,) x y z qw qx qy qz"""
    drift: CurrentForce | None = None
    """correction for the current; None if Gazebo's plugin takes the current into account"""


class World:
    """One Gazebo world with N places for bodies.

    Args:
        text: function that takes a world's name and returns the SDF of the empty world. Each world of a process needs
            its own name, because the names of Gazebo's services contain the world's name.
        n: number of places.
        step: physics step in s that `text` contains.
    """

    def __init__(self, text: Callable[[str], str], n: int, step: float) -> None:
        self.gazebo = bindings.load()
        self.n = n
        self.step = step
        self.pose: FloatArray = np.zeros((n, 7))
        self.velocity: FloatArray = np.zeros((n, 6))
        """(n, 6) velocity of the body origin over ground, body axes"""
        self.current: FloatArray = np.zeros((n, 8))
        """(n, 8) currents: velocity at the top (3) in m/s, velocity at the bottom less velocity at the top (3), z of the top
        in m, 1 / thickness of the layer in 1/m
        """
        self._names: list[str | None] = [None] * n
        self._links: list[Any] = [None] * n
        self._drifts: list[CurrentForce | None] = [None] * n
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
            # Gazebo keeps its callbacks: a strong reference would keep the world alive.
            before, after = weakref.WeakMethod(self._before), weakref.WeakMethod(self._after)
            fixture.on_pre_update(lambda info, ecm: before()(info, ecm))  # type: ignore[misc]
            fixture.on_post_update(lambda info, ecm: after()(info, ecm))  # type: ignore[misc]
            fixture.finalize()
            # Gazebo's server would handle SIGINT and SIGTERM; the run must handle them itself, to save and stop.
            for number, handler in handlers.items():
                signal.signal(number, handler)
        return fixture

    def set_step(self, step: float) -> None:
        """Set the physics step in s of the next `advance`."""
        request = self.gazebo.physics(max_step_size=step, real_time_factor=0.0)
        self._ask("set_physics", request)
        self.step = step
        self._arriving.add(-1)

    def advance(self, new_bodies: Sequence[NewBody], wrench: FloatArray) -> None:
        """Exchange bodies while paused, then make a physics step for each row of `wrench`.

        Args:
            new_bodies: bodies that replace earlier bodies before the first physics step.
            wrench: (steps, n, 6) forces and moments, N and N m, in body axes at the body origin.

        Raises:
            GazeboError: a body did not appear, or Gazebo refused a request.
        """
        if new_bodies:
            self._exchange(new_bodies)
        self._wrench, self._k, self._patience = wrench, 0, 0
        self._server.run(True, len(wrench), bool(self._arriving))
        self._arriving.clear()
        if self._error is not None:
            error, self._error = self._error, None
            raise error
        if self._k != len(wrench):
            raise GazeboError(f"Gazebo made {self._k} of {len(wrench)} physics steps: was it stopped?")

    def _exchange(self, new_bodies: Sequence[NewBody]) -> None:
        create = self.gazebo.entity_factories()
        for new_body in new_bodies:
            old = self._names[new_body.index]
            if old is not None:
                self._ask("remove", self.gazebo.entity(name=old, type=self.gazebo.entity.MODEL))
            # A new name each time, since the old body still exists while the new one is created.
            name = f"body{new_body.index}-{self._born}"
            self._born += 1
            self._names[new_body.index] = name
            entry = create.data.add()
            entry.sdf = f'<?xml version="1.0"?><sdf version="1.11">{new_body.model.format(name=name)}</sdf>'
            entry.name = name
            position, turn = entry.pose.position, entry.pose.orientation
            position.x, position.y, position.z = new_body.pose[:3].tolist()
            turn.w, turn.x, turn.y, turn.z = new_body.pose[3:].tolist()
            self._arriving.add(new_body.index)
            self._links[new_body.index] = None
            self._drifts[new_body.index] = new_body.drift
        self._ask("create_multiple", create)

    def _ask(self, service: str, request: Any) -> None:
        done, answer = self._node.request(
            f"/world/{self._name}/{service}", request, type(request), self.gazebo.boolean, 5000
        )
        if not (done and answer.data):
            raise GazeboError(f"Gazebo refused a request to its service /world/{self._name}/{service}")

    # Gazebo calls `_before` and `_after` in every iteration and loses their exceptions, so `advance` raises them.

    def _before(self, info: Any, ecm: Any) -> None:
        if self._error is not None:
            if info.paused:
                self._unpause()  # Gazebo returns control only at the end of the run
            return
        try:
            if info.paused:
                self._await_bodies(ecm)
            elif self._k < len(self._wrench):
                self._apply_forces(ecm)
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

    def _await_bodies(self, ecm: Any) -> None:
        """Look for the new bodies in a paused iteration; end the pause one iteration after the last body has appeared."""
        sim = self.gazebo.sim
        self._patience += 1
        if self._patience > _PATIENCE:
            missing = sorted(i for i in self._arriving if i >= 0)
            raise GazeboError(f"Gazebo did not create the bodies {missing}; see its messages")
        self._arriving.discard(-1)
        if not self._arriving:
            self._unpause()
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

    def _unpause(self) -> None:
        self._ask("control", self.gazebo.world_control(pause=False))

    def _apply_forces(self, ecm: Any) -> None:
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
    """Return a quaternion (4,) w x y z."""
    return np.array([turn.w(), turn.x(), turn.y(), turn.z()])


def _twist(link: Any, turn: Any, ecm: Any) -> FloatArray:
    """Return the velocity of the link's origin over ground in body axes, (6,)."""
    v = turn.rotate_vector_reverse(link.world_linear_velocity(ecm))
    w = turn.rotate_vector_reverse(link.world_angular_velocity(ecm))
    return np.array([v.x(), v.y(), v.z(), w.x(), w.y(), w.z()])


def _handlers() -> dict[int, Any]:
    """Return the handlers of the signals that Gazebo overrides; empty outside the main thread."""
    if threading.current_thread() is not threading.main_thread() or os.name != "posix":
        return {}
    return {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
