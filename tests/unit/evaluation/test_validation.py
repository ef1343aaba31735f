"""Validation scenarios: like those of a test, and none of them."""

from __future__ import annotations

import numpy as np
import pytest

from auvbench.evaluation.protocol import fingerprint, resolve_conditions
from auvbench.evaluation.rollout import batch_of
from tests import configs
from tests.unit.evaluation.test_protocol import config


def protocol(name: str):
    return configs.protocol(f"protocol={name}")


def scenarios(of: str, n: int = 400, seed: int = 123):
    batch = batch_of(of, configs.training(), np.arange(n), seed)
    batch.task.assign(np.arange(n))
    batch.reset()
    return np.column_stack([batch.task.episodes.start_yaw, batch.task.reference])


@pytest.mark.slow
def test_validation_is_the_test_s_circumstances_with_other_scenarios():
    (test,), (validation,) = (resolve_conditions(protocol(name), config()) for name in ("test", "validation"))
    assert test.config == validation.config
    assert protocol("validation").scenarios == "validation"
    assert protocol("test").scenarios == protocol("robustness").scenarios == "test"
    assert fingerprint(protocol("validation"), [validation]) != fingerprint(protocol("test"), [test])


@pytest.mark.slow
def test_no_validation_scenario_is_a_test_or_a_training_scenario():
    test, validation = scenarios("test"), scenarios("validation")
    training = configs.training("seed=123")
    from auvbench.envs.batch import Batch

    batch = Batch(training, 400)
    batch.reset()
    trained = np.column_stack([batch.task.episodes.start_yaw, batch.task.reference])
    for other in (test, trained):
        assert not (np.abs(validation[:, None, :] - other[None, :, :]) < 1e-9).any()
    # The same distribution: means within four standard errors of a uniform's.
    error = (scenarios("test", 4000).std(axis=0) / np.sqrt(400)) * 4
    assert (np.abs(validation.mean(axis=0) - scenarios("test", 4000).mean(axis=0)) < error).all()


def test_only_scenarios_of_validation_change_the_fingerprint_of_a_protocol():
    mine, theirs = protocol("validation"), protocol("validation")
    theirs.scenarios = "test"
    assert fingerprint(mine, resolve_conditions(mine, config())) != fingerprint(
        theirs, resolve_conditions(theirs, config())
    )
