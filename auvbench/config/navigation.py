"""Define the schemas of the `sensors` and `navigation` groups.

Importing this module imports no code of a sensor or an estimator.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from auvbench.config.fields import below, choice_of, later, number, require
from auvbench.config.fields import name as plain_name
from auvbench.config.ranges import SOUND
from auvbench.errors import ConfigError
from auvbench.registry import BLOCKS

if TYPE_CHECKING:
    from auvbench.config.schema import TrainConfig

TRUTH = "truth"
NONE = "none"
READS = "navigation"
"""Entry in `BlockSpec.reads` of blocks that only an estimator can supply"""
FASTEST = 1000.0
"""highest rate of any sensor, Hz"""


@dataclass(kw_only=True)
class Inertial:
    """Errors of three gyros or three accelerometers."""

    density: float = number(0.0, 10.0)  # rad/s/sqrt(Hz) or m/s2/sqrt(Hz)
    walk: float = number(0.0, 10.0)  # rad/s2/sqrt(Hz) or m/s3/sqrt(Hz)
    tau: float = number(0.0, 1e9, open_low=True)  # s
    turn_on: float = number(0.0, 10.0)  # rad/s or m/s2


@dataclass(kw_only=True)
class Imu:
    """An inertial measurement unit (TDK DS-000176, the ICM-20602; biases of uuv_simulator)."""

    rate: float = number(0.1, FASTEST)  # Hz
    gyro: Inertial
    accelerometer: Inertial


@dataclass(kw_only=True)
class Dvl:
    """A Doppler velocity log with four beams (Water Linked, documentation of the DVL A50)."""

    tilt: float = number(0.01, 1.4)  # rad
    lever: list[float]  # m
    low: float = number(0.0, 1000.0)  # m
    high: float = number(0.1, 1000.0)  # m
    fastest: float = number(0.0, 100.0, open_low=True)  # m/s
    incidence: float = number(0.1, 1.5707)  # rad
    altitudes: list[float]  # m
    rates: list[float]  # Hz
    merit_low: float = number(1e-5, 10.0)  # m/s
    merit_high: float = number(1e-5, 10.0)  # m/s
    scale: float = number(0.0, 1.0)
    mounting: float = number(0.0, 1.0)  # rad
    lost: float = number(0.0, 1.0)
    burst: float = number(0.01, 1e4)  # s
    delay: float = number(0.0, 1.0)  # s
    water_track: bool = False
    water_rate: float = later(number(0.1, FASTEST), 2.0)  # Hz
    water_noise: float = later(number(0.0, 1e3, open_low=True), 1.5)
    water_near: float = later(number(0.0, 1000.0), 1.5)  # m
    water_far: float = later(number(0.0, 1000.0, open_low=True), 4.5)  # m

    @property
    def fastest_rate(self) -> tuple[str, float]:
        """Key of the highest rate, and this rate in Hz."""
        on_water = ("water_rate", self.water_rate) if self.water_track else ("rates", 0.0)
        return max(("rates", max(self.rates)), on_water, key=lambda rate: rate[1])

    def check(self) -> None:
        """Raise ConfigError if keys contradict each other."""
        key = "sensors.dvl."
        _require_place(f"{key}lever", self.lever)
        paired = 0 < len(self.rates) == len(self.altitudes) and all(0.1 <= r <= FASTEST for r in self.rates)
        what = f"have a rate from 0.1 to {FASTEST:g} Hz for each of the {len(self.altitudes)} entries of {key}altitudes"
        require(paired, f"{key}rates", self.rates, what)
        rising = sorted(self.altitudes) == self.altitudes and self.altitudes[-1] >= self.high
        require(
            rising,
            f"{key}altitudes",
            self.altitudes,
            f"be in rising order, up to {key}high={self.high:g} or more",
        )
        below(f"{key}low", self.low, f"{key}high", self.high)
        below(f"{key}merit_low", self.merit_low, f"{key}merit_high", self.merit_high)
        below(f"{key}water_near", self.water_near, f"{key}water_far", self.water_far)


@dataclass(kw_only=True)
class Depth:
    """A pressure sensor (TE Connectivity, data sheet of the MS5837-30BA)."""

    rate: float = number(0.1, FASTEST)  # Hz
    noise: float = number(0.0, 10.0)  # m
    resolution: float = number(0.0, 10.0)  # m
    density: float = number(0.0, 1.0)
    offset: float = number(0.0, 10.0)  # m
    delay: float = number(0.0, 1.0)  # s


@dataclass(kw_only=True)
class Heading:
    """A compass (VectorNav, errors of magnetometers)."""

    rate: float = number(0.1, FASTEST)  # Hz
    noise: float = number(0.0, 3.0)  # rad
    bias: float = number(0.0, 3.0)  # rad
    hard_iron: float = number(0.0, 3.0)  # rad
    soft_iron: float = number(0.0, 3.0)  # rad
    delay: float = number(0.0, 1.0)  # s
    thrusters: float = later(number(0.0, 1.0), 0.0)  # rad/A


@dataclass(kw_only=True)
class Usbl:
    """Acoustic positions from a boat, ultra-short baseline (Cerulean Sonar, documentation of the ROVL)."""

    rate: float = number(0.1, 10.0)  # Hz
    position: list[float]  # m
    range_noise: float = number(1e-3, 100.0)  # m
    angle_noise: float = number(1e-4, 1.0)  # rad
    alignment: float = number(0.0, 1.0)  # rad
    reach: float = number(1.0, 1e4)  # m
    outliers: float = number(0.0, 0.5)
    outlier: float = number(0.0, 1e3)  # m
    lost: float = number(0.0, 0.99)
    burst: float = number(0.01, 1e4)  # s
    delay: float = number(0.0, 10.0)  # s
    vehicles: int = later(number(1, 8), 8)

    def check(self) -> None:
        """Raise ConfigError if keys contradict each other."""
        key = "sensors.usbl."
        _require_place(f"{key}position", self.position)
        # The sound of a ping must arrive before the next ping is sent.
        most = SOUND / self.reach
        what = f"be at most {most:.3g} Hz for reach={self.reach:g}, so that each reading arrives before the next ping; or reduce reach"
        require(self.rate <= most, f"{key}rate", self.rate, what)
        longest = 1.0 / self.rate - self.reach / SOUND
        what = (
            f"be at most {longest:.3g} s: the interval between pings, 1/rate = {1.0 / self.rate:.3g} s, "
            f"less the travel time of sound over reach, {self.reach / SOUND:.3g} s"
        )
        require(self.delay <= longest, f"{key}delay", self.delay, what)


@dataclass(kw_only=True)
class Gnss:
    """A satellite receiver on the vehicle, which works only at the surface."""

    rate: float = number(0.1, FASTEST)  # Hz
    depth: float = number(0.0, 100.0)  # m
    noise: float = number(1e-3, 100.0)  # m
    offset: float = number(0.0, 100.0)  # m


@dataclass(kw_only=True)
class Modem:
    """An acoustic modem that measures the range to a vehicle when it receives this vehicle's message.

    The noise is the noise of the nanomodem in MARUS (see `config.tasks.formation`).
    """

    noise: float = number(1e-3, 100.0)  # m
    beacons: int = number(1, 7)
    memory: float = number(0.0, 1e6, open_low=True)  # s


SENSORS = ("imu", "dvl", "depth", "heading", "usbl", "gnss", "modem")
"""keys of the sensors that a vehicle may have"""


@dataclass(kw_only=True)
class Sensors:
    """Keys of `sensors`: one group of keys for each sensor of the vehicle, None for a sensor that the vehicle lacks."""

    name: str = plain_name()
    imu: Imu | None = None
    dvl: Dvl | None = None
    depth: Depth | None = None
    heading: Heading | None = None
    usbl: Usbl | None = None
    gnss: Gnss | None = None
    modem: Modem | None = None

    def names(self) -> tuple[str, ...]:
        """Return the names of the sensors that the vehicle has."""
        return tuple(name for name in SENSORS if getattr(self, name) is not None)


@dataclass(kw_only=True)
class Start:
    """Standard deviations of the estimate's errors at the start of an episode."""

    position: float = number(1e-6, 1e3)  # m
    velocity: float = number(1e-6, 10.0)  # m/s
    tilt: float = number(1e-6, 1.0)  # rad


@dataclass(kw_only=True)
class Navigation:
    """Key of every `navigation/*.yaml`."""

    needs: ClassVar[tuple[str, ...]] = ()
    """names of the sensors that the estimator needs"""
    is_filter: ClassVar[bool] = False
    """whether the estimate has a covariance"""

    name: str = choice_of(lambda: SCHEMAS)


@dataclass(kw_only=True)
class Ekf(Navigation):
    """An error-state extended Kalman filter."""

    needs: ClassVar[tuple[str, ...]] = ("imu", "depth", "heading")
    is_filter: ClassVar[bool] = True

    start: Start
    gate: float = number(0.5, 1.0)
    inflation: float = number(1e-3, 1e3)
    dvl_scale: bool = False
    heading_bias: bool = False


@dataclass(kw_only=True)
class Model:
    """Keys of model aiding: readings of the velocity through the water that the vehicle's model predicts, and the current as a state."""

    rate: float = number(0.01, FASTEST)  # Hz
    noise: float = number(1e-4, 10.0)  # m/s
    share: float = number(0.0, 10.0)
    settling: float = number(0.0, 1e4)  # s
    current: float = number(0.0, 10.0)  # m/s
    walk: float = number(0.0, 10.0)  # m/s/sqrt(s)


@dataclass(kw_only=True)
class EkfModel(Ekf):
    """The extended Kalman filter with the horizontal current as two more states.

    The filter is aided by the vehicle's model: the predicted velocity through the water is an additional measurement.
    """

    model: Model


@dataclass(kw_only=True)
class DeadReckoning(Navigation):
    """Dead reckoning: integrate the DVL's velocity, rotated to world axes by the attitude from gyros and compass."""

    start: Start
    needs: ClassVar[tuple[str, ...]] = ("imu", "dvl", "depth", "heading")

    settling: float = number(0.01, 1e4)  # s


SCHEMAS: dict[str, type[Navigation]] = {
    TRUTH: Navigation,
    "ekf": Ekf,
    "ekf_model": EkfModel,
    "dead_reckoning": DeadReckoning,
}
"""schemas of the estimators by `navigation.name`; all other code reads an estimator's properties from its schema"""
FILTERS = tuple(name for name, kind in SCHEMAS.items() if kind.is_filter)
"""estimators with a covariance"""
ESTIMATORS = tuple(name for name in SCHEMAS if name != TRUTH)


def _require_place(key: str, values: list[float]) -> None:
    fits = len(values) == 3 and all(map(math.isfinite, values))
    require(fits, key, values, "be three numbers [x, y, z] in m")


def truth() -> Navigation:
    """Return the schema that means the true state without an estimator, for runs of earlier versions."""
    return Navigation(name=TRUTH)


def no_sensors() -> Sensors:
    """Return the schema that means no navigation sensors, for runs of earlier versions."""
    return Sensors(name=NONE)


def is_estimated(config: TrainConfig) -> bool:
    """Return whether agents observe an estimate instead of the true state with `noise`."""
    return bool(config.navigation.name != TRUTH)


def check(config: TrainConfig) -> None:
    """Check sensors and estimator against the rest of a configuration.

    Raises:
        ConfigError: a key of sensors or estimator does not fit; the message names the key and what to type instead.
    """
    sensors, navigation = config.sensors, config.navigation
    for sensor in (sensors.dvl, sensors.usbl):
        if sensor is not None:
            sensor.check()
    _check_blocks(config)
    if not is_estimated(config):
        if sensors.names():
            raise ConfigError(
                f"sensors={sensors.name}: navigation={TRUTH} reads no sensor; use navigation=ekf, or sensors={NONE}"
            )
        return
    _check_alone(config)
    missing = [name for name in navigation.needs if getattr(sensors, name) is None]
    if missing:
        able = "dvl_a50 or survey" if "dvl" in navigation.needs else "bluerov2, dvl_a50 or survey"
        raise ConfigError(
            f"navigation={navigation.name}: needs sensors.{missing[0]}, which sensors={sensors.name} does not have; use "
            f"sensors={able}"
        )
    unread = [
        name for name in ("usbl", "gnss", "modem") if name in sensors.names() and not navigation.is_filter
    ]
    if unread:
        what = "ranges" if unread[0] == "modem" else "positions"
        raise ConfigError(
            f"sensors.{unread[0]}: navigation={navigation.name} cannot use {what}; use navigation=ekf"
        )
    if sensors.modem is not None:
        _check_messages(sensors.modem, config)
    if sensors.gnss is not None and config.task.depth_high < -sensors.gnss.depth:
        raise ConfigError(
            f"sensors.gnss.depth={sensors.gnss.depth:g}: the vehicle stays below task.depth_high={config.task.depth_high:g} and"
            " never has its antenna in the air; raise task.depth_high, or use sensors=dvl_a50"
        )
    if getattr(navigation, "dvl_scale", False) and (sensors.dvl is None or sensors.dvl.scale == 0.0):
        raise ConfigError(
            f"navigation.dvl_scale=true: sensors={sensors.name} has no DVL with a scale error to estimate; use sensors=dvl_a50, or "
            "navigation.dvl_scale=false"
        )
    if sensors.dvl is not None and sensors.dvl.water_track and not isinstance(navigation, EkfModel):
        raise ConfigError(
            f"sensors.dvl.water_track=true: navigation={navigation.name} does not estimate the current and cannot use velocities "
            "through the water; use navigation=ekf_model, or sensors.dvl.water_track=false"
        )
    if getattr(navigation, "heading_bias", False) and not {"usbl", "gnss"} & {*sensors.names()}:
        raise ConfigError(
            f"navigation.heading_bias=true: sensors={sensors.name} measures no positions, without which the bias is unobservable; "
            "use sensors=dvl_usbl, or navigation.heading_bias=false"
        )
    if isinstance(navigation, EkfModel):
        rate, frequency = navigation.model.rate, config.step.frequency
        what = f"be at most {frequency:g} Hz, the rate of the agent's steps (step.frequency)"
        require(rate <= frequency * (1.0 + 1e-9), "navigation.model.rate", rate, what)
    if sensors.dvl is not None and not config.world.has_bottom:
        raise ConfigError(
            f"sensors.dvl: needs a bottom, and world={config.world.name} has none; use world=seabed, slope, rough or tank, world=field "
            "with world.bottom_depth=30, or sensors=bluerov2"
        )
    _check_rates(config)


def _check_alone(config: TrainConfig) -> None:
    """Refuse a simulator without navigation sensors, and refuse other sources of sensor errors: `noise` and some disturbances."""
    chosen = f"navigation={config.navigation.name}"
    if config.simulator.name != "fossen":
        raise ConfigError(
            f"{chosen}: simulator={config.simulator.name} does not simulate navigation sensors; use simulator=fossen"
        )
    noise = config.noise
    for key in ("position", "yaw"):
        if getattr(noise, key).high * noise.scale > 0.0:
            raise ConfigError(
                f"noise.{key}.high={getattr(noise, key).high:g}: must be 0 with {chosen}, whose sensors have their own errors; use "
                "noise=none"
            )
    disturbance: Any = config.disturbance
    if disturbance.sensor.active:
        raise ConfigError(
            f"disturbance.sensor: must be 0 with {chosen}, whose sensors have their own errors; use a disturbance without sensor errors"
        )
    if disturbance.delay.observation > 0.0:
        raise ConfigError(
            f"disturbance.delay.observation={disturbance.delay.observation:g}: must be 0 with {chosen}, whose sensors have their own delays"
        )


def _check_messages(modem: Modem, config: TrainConfig) -> None:
    """Refuse a modem without acoustic messages, a team in which all vehicles are beacons, and an IMU slower than the messages."""
    task: Any = config.task
    if getattr(task, "messages", "") != "acoustic":
        chosen = f"task.messages={task.messages}" if hasattr(task, "messages") else f"task={task.name}"
        raise ConfigError(
            f"sensors.modem: {chosen} has no acoustic messages; use task=formation with task.messages=acoustic, or another "
            "sensors=NAME"
        )
    what = f"be less than task.vehicles={task.team}: the other vehicles measure their ranges to the beacons"
    require(modem.beacons < task.team, "sensors.modem.beacons", modem.beacons, what)
    assert config.sensors.imu is not None
    least = 1.0 / task.turn_time
    what = f"be at least {least:.3g} Hz, so that at most one vehicle sends a message between two samples"
    require(config.sensors.imu.rate >= least, "sensors.imu.rate", config.sensors.imu.rate, what)


def _check_rates(config: TrainConfig) -> None:
    """Refuse rates and delays of sensors that a step cannot represent.

    The IMU may be at most as fast as the physics. Each other sensor may be at most as fast as the IMU, and its delay
    at most the time between two readings.
    """
    sensors = config.sensors
    assert sensors.imu is not None
    fastest = 1.0 / config.simulator.max_step
    if sensors.imu.rate > fastest * (1.0 + 1e-9):
        raise ConfigError(
            f"sensors.imu.rate={sensors.imu.rate:g}: must be at most {fastest:g} Hz, the rate of the physics "
            f"(simulator.max_step={config.simulator.max_step:g})"
        )
    for name in ("dvl", "depth", "heading", "usbl", "gnss"):
        sensor = getattr(sensors, name)
        if sensor is None:
            continue
        key, most = sensor.fastest_rate if name == "dvl" else ("rate", sensor.rate)
        if most > sensors.imu.rate * (1.0 + 1e-9):
            raise ConfigError(
                f"sensors.{name}.{key}={most:g}: must be at most {sensors.imu.rate:g} Hz, the rate of the IMU"
            )
        if name in ("usbl", "gnss"):  # `Usbl.check` checks the delay; `Gnss` has no delay.
            continue
        what = f"be at most {1.0 / most:.3g} s, the time between two readings"
        require(sensor.delay <= 1.0 / most, f"sensors.{name}.delay", sensor.delay, what)


def _check_blocks(config: TrainConfig) -> None:
    """Refuse observation blocks that are not available with the chosen navigation."""
    for name in config.task.observation:
        reads = BLOCKS[name].reads
        if READS in reads and not is_estimated(config):
            raise ConfigError(f"task.observation: {name} needs an estimator; use navigation=ekf")
        if name == "position_sd" and not config.navigation.is_filter:
            raise ConfigError(
                f"task.observation: position_sd needs a covariance, which navigation={config.navigation.name} does not have; "
                f"use navigation={' or '.join(FILTERS)}"
            )
        if "task" in reads and is_estimated(config):
            raise ConfigError(
                f"task.observation: {name} reads fields of the task that are computed from the vehicle's true position; use "
                f"navigation={TRUTH}, or leave the block out"
            )
