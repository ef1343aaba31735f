"""What a simulator cannot is refused while the configuration is checked."""

from dataclasses import replace

import pytest

from auvbench.config import simulators
from auvbench.config.compose import compose
from auvbench.config.simulators import Capabilities
from auvbench.config.validate import train_config
from auvbench.errors import ConfigError
from auvbench.registry import SIMULATORS


@pytest.fixture
def plain(monkeypatch):
    """The embedded simulator, as if it could do less."""

    def limit(**changes):
        able = {
            "exact_resume": False,
            "deterministic": False,
            "scales": False,
            "currents": "steady",
        } | changes
        plain = replace(SIMULATORS["fossen"], capabilities=Capabilities(**able))
        able = replace(plain, name="able", capabilities=Capabilities(True, True, True, "sheared", True))
        monkeypatch.setitem(SIMULATORS.entered, "fossen", plain)
        monkeypatch.setitem(SIMULATORS.entered, "able", able)

    return limit


def check(*overrides):
    return train_config(compose("train", list(overrides)))


@pytest.mark.slow
def test_the_embedded_simulator_takes_all_that_can_be_asked():
    check("disturbance=severe", "disturbance.current.profile.factor=0.5", "disturbance.current.speed=0.3")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("overrides", "key", "word"),
    [
        (["disturbance=gauss_markov"], "disturbance.current.gauss_markov", "varying"),
        (["disturbance=depth_current"], "disturbance.current.profile", "sheared"),
        (["disturbance=waves"], "disturbance.waves.height=0.88", "waves"),
        (["disturbance=randomised"], "disturbance.randomisation.mass", "factors that differ from the sheet"),
    ],
)
def test_what_it_cannot_is_refused_with_the_key_and_a_way_out(plain, overrides, key, word):
    plain()
    with pytest.raises(ConfigError) as caught:
        check(*overrides)
    message = str(caught.value)
    assert message.startswith(f"{key}: ")
    assert word in message
    assert "simulator=fossen" in message
    assert message.endswith("simulator=able")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("simulator", "remedy"),
    [
        (["simulator=gazebo", "simulator.hydrodynamics=published"], "simulator.hydrodynamics=corrected"),
        (["simulator=ros2", "simulator.clock=wall"], "simulator.clock=lockstep"),
    ],
)
def test_the_remedy_is_the_option_that_restricts(simulator, remedy):
    with pytest.raises(ConfigError) as caught:
        check(*simulator, "disturbance=gauss_markov")
    proposed = str(caught.value).rpartition("; use ")[2].split(" or ")
    assert proposed[0] == remedy
    assert simulator[0] not in proposed
    check(simulator[0], remedy, "disturbance=gauss_markov")


@pytest.mark.slow
def test_a_steady_current_passes_where_one_is_taken_and_not_where_there_is_none(plain):
    plain()
    check("disturbance=current")
    plain(currents="none")
    with pytest.raises(ConfigError, match="needs a steady current"):
        check("disturbance=current")


@pytest.mark.slow
@pytest.mark.parametrize("simulator", [["gazebo"], ["ros2"], ["ros2", "simulator.clock=wall"]], ids=str)
def test_waves_need_the_embedded_simulator(simulator):
    name, *more = simulator
    with pytest.raises(ConfigError) as caught:
        check(f"simulator={name}", *more, "disturbance=sea_state_2")
    assert str(caught.value).startswith("disturbance.waves.height=0.3: ")
    assert str(caught.value).endswith("; use simulator=fossen")


@pytest.mark.slow
def test_every_simulator_has_a_schema_and_a_file():
    for name in SIMULATORS.own:
        assert issubclass(SIMULATORS[name].schema, simulators.Simulator)
        assert compose("train", [f"simulator={name}"]).simulator.name == name


def test_a_group_is_chosen_and_not_replaced_by_values():
    with pytest.raises(ConfigError, match="~simulator: a key cannot be removed"):
        check("~simulator", "+simulator={name: fossen}")
