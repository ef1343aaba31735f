"""The checks of the simulators' contract find simulators that break it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from auvbench.simulators.fossen import FossenSimulator
from auvbench.testing import ConformanceError
from auvbench.testing import simulators as contract
from auvbench.vehicles import sheet


class Noisy(FossenSimulator):
    def step(self, command, duration):
        super().step(command + 0.01 * np.random.uniform(), duration)  # noqa: NPY002


class Crowded(FossenSimulator):
    def step(self, command, duration):
        super().step(command * 0.9**self.n, duration)


class Forgetful(FossenSimulator):
    def state_dict(self):
        return {}


class Still(FossenSimulator):
    def set_current(self, velocity, bottom=None, depths=(0.0, 1.0)):
        pass


class Moving(FossenSimulator):
    def reset(self, indices, pose, velocity, scales=None):
        super().reset(np.arange(self.n), np.repeat(pose[:1], self.n, 0), np.zeros((self.n, 6)))


@pytest.mark.parametrize(
    ("kind", "check", "message"),
    [
        (Noisy, contract.motion_is_deterministic, "generator of numpy.random"),
        (Crowded, contract.motion_does_not_depend_on_the_batch, "a vehicle alone and among three"),
        (Forgetful, contract.its_state_comes_back, "KeyError"),
        (Still, contract.it_does_what_it_declares, "must carry a vehicle along"),
        (
            Moving,
            contract.reset_puts_vehicles_where_it_says,
            "reset of vehicle 1 must not move the other vehicles",
        ),
    ],
)
def test_a_simulator_that_breaks_its_contract(
    kind: type[FossenSimulator], check: Callable[..., None], message: str
) -> None:
    with pytest.raises((ConformanceError, KeyError)) as caught:
        check(lambda n: kind(sheet.load("bluerov2"), n))
    assert message in f"{type(caught.value).__name__}: {caught.value}"
