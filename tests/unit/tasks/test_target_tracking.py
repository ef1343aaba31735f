"""Following a target by its ranges, against the definition in docs/moving-targets.md."""

from __future__ import annotations

import numpy as np
import pytest

from auvbench.agents.base import make
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.tasks import rows
from tests import configs
from tests.unit.tasks.test_tasks import HEAVY, advance, batch_of, put

EXACT = "task.range_noise=0.001", "task.message_loss=0"
IDLE = np.zeros((1, 8))


def test_a_ping_arrives_late_and_its_range_is_to_where_the_target_was() -> None:
    batch = batch_of("tracking", *EXACT)
    e, spec = batch.task.episodes[0], batch.task.spec
    targets = [np.array(e.target)]
    for step in range(1, 15):
        heard = batch.step(IDLE).observation[0, spec["pings"]].reshape(4, 5)
        targets.append(np.array(e.target))
        # It is sent at 1 s, takes 0.355 s, and the sound some ms for 4 m: it is heard at 1.4 s.
        assert heard[0, 4] == pytest.approx(0.1 * step if step < 14 else 0.4)
    place = batch.simulator.pose[0, :3]
    assert heard[0, 3] == pytest.approx(np.linalg.norm(place - targets[10]), abs=0.01)
    assert heard[0, 2] == pytest.approx(targets[10][2] - place[2], abs=1e-5)
    np.testing.assert_allclose(heard[0, :2], 0.0, atol=1e-6)  # heard here
    assert heard[1, 3] == pytest.approx(np.linalg.norm(np.array(e.start) - targets[0]), abs=0.01)
    assert np.linalg.norm(place - targets[14]) != pytest.approx(heard[0, 3], abs=0.01)


def test_the_observation_has_only_what_was_heard() -> None:
    """The true target moves elsewhere, which the vehicle learns by the next ping alone."""
    here, there = (batch_of("tracking", *EXACT) for _ in range(2))
    there.task.episodes[0].centre[:2] += 2.0
    for step in range(1, 15):
        mine, theirs = here.step(IDLE).observation, there.step(IDLE).observation
        assert np.array_equal(mine, theirs) == (step < 14)
        assert not np.array_equal(here.task.reference, there.task.reference)


def test_the_start_shows_the_target_no_better_than_the_prior() -> None:
    """The circle's angle is known: the start less that part of the circle is a place of the target."""
    n = 200
    batch = batch_of("tracking", n=n)
    e = batch.task.episodes
    start, target = batch.simulator.pose[:, :3], e.target
    away = np.linalg.norm(start - target, axis=1)
    assert away.min() >= 1.0
    assert away.max() <= 8.0
    shown = start[:, :2] - 4.0 * np.stack([np.cos(e.angle), np.sin(e.angle)], axis=1)
    off = shown - target[:, :2]
    assert 0.9 < np.sqrt((off**2).mean()) < 1.15
    yaw = np.arctan2(-np.sin(e.angle), -np.cos(e.angle))
    assert np.abs(np.angle(np.exp(1j * (e.start_yaw - yaw)))).max() <= np.pi / 6 + 1e-9
    # The estimator begins about the same believed place.
    wide = batch_of("tracking", "task.range_noise=1000", "task.start_radius=0", n=20)
    believed, angle = wide.task.believed.estimate[:, :2], wide.task.episodes.angle
    circle = 4.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    np.testing.assert_allclose(wide.simulator.pose[:, :2], believed + circle, atol=0.05)


def test_nothing_is_heard_if_every_ping_is_lost() -> None:
    batch = batch_of("tracking", "task.message_loss=1")
    for _ in range(30):
        seen = batch.step(IDLE).observation[0, batch.task.spec["pings"]].reshape(4, 5)
    np.testing.assert_allclose(seen[:, 4], 3.0, rtol=1e-6)


def test_the_estimator_is_consistent_and_learns_from_the_circle() -> None:
    """With errors as large as its covariance says, the mean of the normalised squared error (NEES) of two numbers is 2."""
    n = 60
    config = configs.training("task=tracking", "algo=pid", HEAVY)
    batch = Batch(config, n, seed=11, validation=True, autoreset=False)
    agent, errors, nees = make(config, batch.vehicle), [], []
    observation = batch.reset()
    agent.reset(np.arange(n))
    for step in range(401):
        if step % 100 == 0:
            off = batch.task.believed.estimate[:, :2] - batch.task.episodes.target[:, :2]
            covariance = batch.task.believed.covariance[:, :2, :2]
            np.testing.assert_allclose(covariance, covariance.swapaxes(1, 2), atol=1e-12)
            nees.append(np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off).mean())
            errors.append(np.sqrt((off**2).sum(axis=1).mean()))
        observation = batch.step(agent.act(observation)).observation
    assert 1.0 < np.mean(nees) < 4.0
    assert errors[-1] < 0.9 < errors[0]


@pytest.mark.parametrize(
    ("away", "outcome"),
    [(0.9, rows.COLLISION), (1.1, rows.GOES_ON), (7.9, rows.GOES_ON), (8.1, rows.OUT_OF_BOUNDS)],
)
def test_an_episode_ends_by_the_distance_to_the_target(away: float, outcome: int) -> None:
    batch = batch_of("tracking", "task.speed_low=0.001", "task.speed_high=0.001")
    x, y, z = batch.task.episodes[0].target
    put(batch, [x + away, y, z])
    assert advance(batch)[1] == outcome


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("task.orbit=10", "task.orbit=10: must be less than task.bounds=8"),
        ("task.prior=1.2", "task.prior=1.2: must be at most 1: the target may be"),
        (
            "step.frequency=0.8",
            "task.ping_interval=1: must be at least 1.25 s, one agent step \\(step.frequency=0.8 Hz\\)",
        ),
        ("task.orbit=1.2", "task.orbit=1.2: must be more than 1.5"),
        ("task.ping_interval=0.3", "task.ping_interval=0.3: must be at least 0.3657"),
        ("task.start_radius=5", "task.start_radius=5: must be at most 4, task.bounds less task.orbit"),
        ("task.message_loss=2", "task.message_loss=2"),
        ("task.observation=[goal_error]", "goal_error is not a block of task=tracking"),
        ("task.vehicles=2", "task.vehicles"),
    ],
)
def test_wrong_values_are_refused_in_one_line(override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        configs.training("task=tracking", override)
    assert "\n" not in str(caught.value)
