"""What of `simulator=ros2` makes another run or another test, and what it cannot."""

import dataclasses

import pytest
from omegaconf import OmegaConf

from auvbench.config.compose import compose
from auvbench.config.validate import evaluate_config, train_config
from auvbench.errors import ConfigError
from auvbench.evaluation.protocol import as_played, fingerprint, resolve_conditions
from auvbench.runs.identity import run_id


def plain(*overrides):
    return OmegaConf.to_container(compose("train", ["algo=pid", *overrides], folder=None), resolve=True)


@pytest.mark.slow
def test_the_clock_of_a_test_is_in_its_fingerprint_and_the_server_s_place_is_not():
    protocol = evaluate_config(
        compose("evaluate", ["protocol=ros2", "protocol.episodes=2"], folder=None)
    ).protocol
    conditions = resolve_conditions(protocol, plain())
    name = "simulator=ros2"

    def by(clock, **where):
        played = as_played(conditions, {name: clock})
        moved = [
            dataclasses.replace(
                c,
                config=dataclasses.replace(
                    c.config, simulator=dataclasses.replace(c.config.simulator, **where)
                ),
            )
            if c.name == name
            else c
            for c in played
        ]
        return fingerprint(protocol, moved)

    assert len({by("lockstep"), by("clock"), by("wall")}) == 3
    assert by("lockstep") == by("lockstep", namespace="elsewhere", timeout=1.0)
    # A configuration that names the clock is played by no other.
    assert as_played(conditions, {}) == conditions


@pytest.mark.slow
def test_where_a_server_is_makes_no_other_run():
    here = plain("simulator=ros2")
    assert run_id(here) == run_id(plain("simulator=ros2", "simulator.namespace=b", "simulator.timeout=1"))
    assert run_id(here) != run_id(plain("simulator=ros2", "simulator.clock=wall"))
    assert run_id(here) != run_id(plain())


@pytest.mark.slow
@pytest.mark.parametrize(
    "asked", ["disturbance=gauss_markov", "disturbance=depth_current", "disturbance=randomised"]
)
def test_what_needs_lockstep_is_refused_without_it(asked):
    with pytest.raises(
        ConfigError, match=r"simulator=ros2 does not have as configured; use simulator.clock=lockstep"
    ):
        train_config(compose("train", ["simulator=ros2", asked], folder=None))
    train_config(compose("train", ["simulator=ros2", "simulator.clock=lockstep", asked], folder=None))
