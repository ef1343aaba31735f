"""Measure sensors and estimators against theory: `python -m benchmarks.navigation`; `--write` renews docs/navigation.md."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from auvbench.agents import base as agents
from auvbench.config.navigation import EkfModel
from auvbench.dynamics.frames import quaternion, rotation
from auvbench.envs.batch import Batch
from auvbench.envs.settings import configuration
from auvbench.tasks.navigation.estimator import Navigation
from auvbench.tasks.navigation.state import DEPTH, DVL, HEADING, STATES, USBL, WATER

Floats = NDArray[np.float64]
PAGE = Path(__file__).parents[1] / "docs" / "navigation.md"
MARK = "<!-- measured: python -m benchmarks.navigation --write -->\n"
END = "<!-- end -->\n"

BASE = ("algo=pid", "noise=none", "world=slope", "sensors=dvl_a50", "navigation=ekf")
TRUE_HEADING = ("sensors.heading.bias=0", "sensors.heading.hard_iron=0", "sensors.heading.soft_iron=0")
MATCHED = (
    *TRUE_HEADING,
    *("sensors.depth.density=0", "sensors.depth.offset=0", "sensors.depth.resolution=0"),
    *("sensors.dvl.scale=0", "sensors.dvl.mounting=0", "sensors.dvl.lost=0", "sensors.dvl.delay=0"),
    *("sensors.imu.gyro.tau=1e8", "sensors.imu.accelerometer.tau=1e8", "navigation.gate=1"),
)
"""sensors whose errors are those of the filter's model"""
WATER_TRACK = "navigation=ekf_model", "sensors.dvl.water_track=true"
NO_SHEET = "navigation.model.settling=1e4"
"""no readings of the sheet"""
ON_WATER = *WATER_TRACK, NO_SHEET, "sensors.dvl.lost=1", "navigation.model.walk=0"
"""a DVL that never has lock on the bottom, a current that is drawn as the filter assumes, and no readings of the sheet"""
TASKS = ("waypoint_state", "station_keeping", "trajectory_tracking", "path_following", "docking", "transit")
EPISODES, SECONDS = 500, 60
HOUR, AT_REST = 3600, 4
"""s, and vehicles, of the IMU's recording"""
KILOMETRE, SPEED, DRAWS = 1000.0, 1.0, 64
LATE = "sensors.usbl.alignment=0", "sensors.usbl.outliers=0", "sensors.usbl.lost=0", "sensors.usbl.delay=0.79"
"""a USBL whose errors are those of the filter's model"""
LONG = 100
"""s on a trajectory"""
TEAMS = 200
KNOWN, LOSS = 40, 60
"""s with the DVL, then without"""


def batch(*words: str, n: int) -> Batch:
    made = Batch(configuration(overrides=[*BASE, *words]), n, autoreset=False)
    made.reset()
    return made


def estimator(one: Batch) -> Navigation:
    assert one.navigation is not None
    return one.navigation


def allan(samples: Floats, dt: float, tau: float) -> float:
    """Return the Allan deviation of samples (k, channels) at a time in s: overlapping, mean over the channels."""
    m = round(tau / dt)
    sums = np.concatenate([np.zeros((1, samples.shape[1])), np.cumsum(samples, axis=0)]) / m
    means = sums[m:] - sums[:-m]
    return float(np.sqrt(0.5 * np.mean((means[m:] - means[:-m]) ** 2)))


def walked(walk: float, tau_b: float, tau: float) -> float:
    """Return the Allan deviation of a Gauss-Markov process at a time in s (IEEE Std 952-1997, C.1.1.6)."""
    t = tau / tau_b
    variance = (walk * tau_b) ** 2 / tau * (1.0 - (3.0 - 4.0 * math.exp(-t) + math.exp(-2.0 * t)) / (2.0 * t))
    return math.sqrt(variance)


def imu() -> Iterator[Sequence[str]]:
    """Record the IMUs of vehicles at rest for an hour."""
    own = ("sensors.imu.gyro.tau=20", "sensors.imu.gyro.walk=1e-4")
    one = batch(*own, "sensors.depth.rate=0.1", "sensors.heading.rate=0.1", "sensors.dvl.lost=1", n=AT_REST)
    navigation, settings = estimator(one), one.config.sensors.imu
    assert settings
    dt, count = 1.0 / settings.rate, round(HOUR * settings.rate)
    rates, forces = np.empty((count, 3 * AT_REST)), np.empty((count, 3 * AT_REST))
    nothing, every = np.zeros_like(one._action), round(settings.rate * one.task.duration)
    for k in range(count):
        navigation.sample(one.simulator, dt)
        rates[k], forces[k] = navigation.state["rates"].ravel(), navigation.state["specific_force"].ravel()
        if (k + 1) % every == 0:
            one.task.episodes.steps += 1
            navigation.conclude(nothing, nothing, np.zeros(one.n))
    for name, samples, part in (
        ("gyro", rates, settings.gyro),
        ("accelerometer", forces, settings.accelerometer),
    ):
        for tau in (0.1, 1.0, 10.0) if name == "gyro" else (0.1,):
            theory = math.hypot(part.density / math.sqrt(tau), walked(part.walk, part.tau, tau))
            found = allan(samples, dt, tau)
            yield (
                name,
                f"{tau:g} s",
                f"{found:.3g}",
                f"{theory:.3g}",
                f"{100.0 * (found / theory - 1.0):+.1f} %",
            )


def doppler() -> Iterator[Sequence[str]]:
    """Compare the DVL's noise with the prediction of the least-squares solution."""
    merit = "sensors.dvl.merit_low=0.02", "sensors.dvl.merit_high=0.02"
    one = batch(*MATCHED, *merit, n=2000)
    navigation, errors = estimator(one), []
    d, count = navigation.state, 0.0
    for _ in range(20):
        navigation.sample(one.simulator, 0.19)
        if (d["innovations"][:, 0].sum()) > count:
            count = d["innovations"][:, 0].sum()
            errors.append(d["dvl_velocity"].copy())
    sine, cosine = float(navigation.parameters[0].dvl_sine), float(navigation.parameters[0].dvl_cosine)
    sd = 0.02 * math.sqrt(2.0) * sine
    for k, axis in enumerate("xyz"):
        theory = sd / (math.sqrt(2.0) * sine) if k < 2 else sd / (2.0 * cosine)
        found = float(np.std(np.concatenate(errors)[:, k]))
        yield (
            axis,
            f"{1e3 * found:.2f} mm/s",
            f"{1e3 * theory:.2f} mm/s",
            f"{100.0 * (found / theory - 1.0):+.1f} %",
        )


def errors_of(one: Batch) -> Floats:
    """Return the errors (n, 15) of the filter's states."""
    d, pose = estimator(one).state, one.simulator.pose
    R = rotation(pose[:, 3:])
    apart = R @ np.swapaxes(rotation(d["attitude"]), 1, 2)
    turned = 0.5 * np.stack(
        [apart[:, 2, 1] - apart[:, 1, 2], apart[:, 0, 2] - apart[:, 2, 0], apart[:, 1, 0] - apart[:, 0, 1]], 1
    )
    velocity = np.einsum("nij,nj->ni", R, one.simulator.velocity[:, :3])
    force = d["turn_on_acceleration"] + d["walk_acceleration"] - d["acceleration_bias"]
    rates = d["turn_on_rates"] + d["walk_rates"] - d["rate_bias"]
    return np.concatenate([pose[:, :3] - d["position"], velocity - d["velocity"], turned, force, rates], 1)


def band(values: Floats) -> tuple[float, float]:
    """Return the mean of one value per episode and half the width of its 95 % band, by the spread between the episodes.

    Errors are correlated within an episode, so that counting each time as a draw would make the band too narrow.
    """
    return float(np.mean(values)), 1.96 * float(np.std(values, ddof=1)) / math.sqrt(len(values))


def shown(values: Floats) -> str:
    """Return a mean, its band, and whether it has 1 inside."""
    mean, half = band(values)
    return f"{mean:.2f} ± {half:.2f} {'inside' if abs(mean - 1.0) <= half else 'outside'}"


def consistency(task: str, *words: str) -> Floats:
    """Return NEES per state and NIS of DVL, depth and heading (4, n), means over each episode; PID steers by the estimate."""
    one = batch(f"task={task}", "world=slope", f"task.time_limit={2 * SECONDS}", *words, n=EPISODES)
    agent, navigation = agents.make(one.config, one.vehicle), estimator(one)
    current = np.zeros((EPISODES, 3))
    if isinstance(one.config.navigation, EkfModel):
        sd = one.config.navigation.model.current
        current[:, :2] = np.random.default_rng(1).normal(0.0, sd, (EPISODES, 2))
        one.simulator.set_current(current)
    agent.reset(np.arange(EPISODES))
    seen, nees = one.task.observation, []
    for step in range(10 * SECONDS):
        seen = one.step(agent.act(seen)).observation
        if step % 20 == 19:
            inverse = np.linalg.inv(navigation.covariance)
            x = np.concatenate([errors_of(one), current[:, :2] - navigation.state["current"]], axis=1)
            x = x[:, : inverse.shape[1]]  # without a current if it is not a state
            nees.append(np.einsum("ni,nij,nj->n", x, inverse, x) / x.shape[1])
    sensors = [WATER if "sensors.dvl.lost=1" in words else DVL, DEPTH, HEADING]
    nis = (navigation.state["nis"] / np.maximum(navigation.state["innovations"], 1.0))[:, sensors]
    return np.concatenate([np.mean(nees, axis=0)[None], nis.T])


def filters() -> Iterator[Sequence[str]]:
    """Measure the consistency of the filter on each task."""
    cases: list[tuple[str, str, tuple[str, ...]]] = [(task, "matched", MATCHED) for task in TASKS]
    cases += [(TASKS[0], "noise x 3", (*MATCHED, "navigation.inflation=0.3333333333"))]
    cases += [(TASKS[0], "matched, water track only", (*MATCHED, *ON_WATER))]
    cases += [(TASKS[0], "dvl_a50", ()), (TASKS[0], "survey", ("sensors=survey",))]
    for task, name, words in cases:
        yield task, name, *map(shown, consistency(task, *words))


def on_trajectories(*words: str) -> tuple[float, Floats, Floats]:
    """Return the RMS error of the position in m, and NEES per state and NIS of the USBL, means over each episode (DRAWS,)."""
    one = batch("task=trajectory_tracking", f"task.time_limit={LONG + 10}", *words, n=DRAWS)
    agent, navigation = agents.make(one.config, one.vehicle), estimator(one)
    agent.reset(np.arange(DRAWS))
    seen, squares, nees = one.task.observation, [], []
    for step in range(10 * LONG):
        seen = one.step(agent.act(seen)).observation
        if step % 20 == 19:
            x, inverse = errors_of(one), np.linalg.inv(navigation.covariance[:, :STATES, :STATES])
            nees.append(np.einsum("ni,nij,nj->n", x, inverse, x) / STATES)
            squares.append(np.sum(x[:, :3] ** 2, axis=1))
    d = navigation.state
    nis: Floats = d["nis"][:, USBL] / np.maximum(d["innovations"][:, USBL], 1.0)
    return math.sqrt(float(np.mean(squares))), np.mean(nees, axis=0), nis


def positions() -> Iterator[Sequence[str]]:
    """Measure what positions are worth, and errors as states of the filter."""
    scale, bias = "navigation.dvl_scale=true", "navigation.heading_bias=true"
    wide = "sensors.dvl.scale=0.05", "sensors.heading.bias=0.0524"
    cases: tuple[tuple[str, str, tuple[str, ...]], ...] = (
        ("matched, late `dvl_usbl`", "", ("sensors=dvl_usbl", *MATCHED, *LATE)),
        ("the same, scale 5 %", "`dvl_scale`", ("sensors=dvl_usbl", *MATCHED, *LATE, *wide[:1], scale)),
        (
            "the same, scale 5 %, heading 3°",
            "both",
            ("sensors=dvl_usbl", *MATCHED, *LATE, *wide, scale, bias),
        ),
        ("matched `dvl_a50`, scale 5 %", "", (*MATCHED, *wide[:1])),
        ("matched `dvl_a50`, scale 5 %", "`dvl_scale`", (*MATCHED, *wide[:1], scale)),
        ("`dvl_a50`", "", ()),
        ("`dvl_a50`", "`dvl_scale`", (scale,)),
        ("`usbl`", "", ("sensors=usbl",)),
        ("`usbl`", "`ekf_model`", ("sensors=usbl", "navigation=ekf_model")),
        ("`dvl_usbl`", "", ("sensors=dvl_usbl",)),
        ("`dvl_usbl`", "`dvl_scale`", ("sensors=dvl_usbl", scale)),
        ("`dvl_usbl`", "both", ("sensors=dvl_usbl", scale, bias)),
    )
    for name, states, words in cases:
        error, nees, nis = on_trajectories(*words)
        yield name, states, f"{error:.2f} m", shown(nees), shown(nis) if nis.any() else ""


def after_loss(*words: str) -> tuple[Floats, Floats]:
    """Return the growth of the horizontal errors (n,) in m while the DVL is lost, and the NEES of horizontal positions at the end."""
    limit = f"task.time_limit={KNOWN + LOSS + 10}"
    one = batch("task=trajectory_tracking", limit, *words, n=DRAWS)
    agent, navigation = agents.make(one.config, one.vehicle), estimator(one)
    agent.reset(np.arange(DRAWS))
    seen, errors = one.task.observation, []
    for seconds in (KNOWN, LOSS):
        for _ in range(10 * seconds):
            seen = one.step(agent.act(seen)).observation
        errors.append(navigation.pose[:, :2] - one.simulator.pose[:, :2])
        navigation.parameters["dvl_lost"] = 1.0
    inverse = np.linalg.inv(navigation.covariance[:, :2, :2])
    nees: Floats = np.einsum("ni,nij,nj->n", errors[1], inverse, errors[1]) / 2.0
    grown: Floats = np.linalg.norm(errors[1] - errors[0], axis=1)
    return grown, nees


def losses() -> Iterator[Sequence[str]]:
    """Measure how far estimates drift while a DVL is lost."""
    for water, words in (
        ("still", ()),
        ("current 0.5 m/s", ("disturbance=current", "disturbance.current.speed=0.5")),
        ("still, vehicle drawn", ("disturbance=randomised",)),
    ):
        for kind, own in (
            ("`ekf`", ()),
            ("`ekf_model`", ("navigation=ekf_model",)),
            ("`ekf_model`, water track", WATER_TRACK),
            ("water track, no sheet", (*WATER_TRACK, NO_SHEET)),
        ):
            grown, nees = after_loss(*own, *words)
            rms = math.sqrt(float(np.mean(grown**2)))
            yield water, kind, f"{rms:.2f} m", f"{np.median(grown):.2f} m", f"{np.mean(nees):.2f}"


def in_team(*words: str) -> tuple[list[float], Floats, int]:
    """Return root mean squares of the errors in m of beacons and others, the NEES per coordinate of others (k,), and the number of
    successful teams, until each episode's end.
    """
    one = batch("world=open", "vehicle=bluerov2_heavy", "task=formation", "sensors=team", *words, n=TEAMS)
    agent, navigation = agents.make(one.config, one.vehicle), estimator(one)
    agent.reset(np.arange(one.n))
    seen, sums, won = one.task.observation, np.zeros((3, one.n)), 0
    live = np.ones(one.n, dtype=bool)
    while live.any():
        transition = one.step(agent.act(seen))
        seen, d = transition.observation, navigation.state
        sums[:, live] = [d[name][live] for name in ("error_squared_sum", "nees", "counted")]
        live[transition.ended] = False
        won += sum(record["outcome"] == "success" for record in transition.records[:: one.team])
    beacon = np.arange(one.n) % one.team < navigation.parameters[0].beacons
    errors = [math.sqrt(sums[0, who].sum() / sums[2, who].sum()) for who in (beacon, ~beacon)]
    return errors, (sums[1] / sums[2] / 3.0)[~beacon], won


def messages() -> Iterator[Sequence[str]]:
    """Measure what ranges are worth to the vehicles of a team that drift; without messages, nothing else changes."""
    two = "task.vehicles=4", "sensors.modem.beacons=2", "sensors.usbl.vehicles=2"
    matched = (*(word for word in MATCHED if "dvl" not in word and "gate" not in word), *LATE[:3])
    for sensors, own in (("matched", matched), ("`team`", ())):
        for beacons, words in (("1 of 3", ()), ("2 of 4", two)):
            for ranges, lost in (("none", ("task.message_loss=1",)), ("independent", ("sensors.modem.memory=1e-3",)), ("as `team`", ())):  # fmt: skip
                errors, nees, won = in_team("navigation=ekf_model", *own, *words, *lost)
                both = (f"{error:.2f} m" for error in errors)
                yield sensors, beacons, ranges, *both, shown(nees), f"{won} of {TEAMS}"


def straight(*words: str) -> Floats:
    """Return the horizontal errors (draws,) at the end of a straight kilometre, as shares of it."""
    still = ("world.dip=0", "task.max_steps=1000000", "sensors.dvl.lost=0")
    one = batch(*still, *words, n=DRAWS)
    navigation, simulator = estimator(one), one.simulator
    yaw = np.linspace(0.0, 2.0 * math.pi, DRAWS, endpoint=False)
    simulator.pose[:, 3:] = quaternion(np.stack([np.zeros(DRAWS), np.zeros(DRAWS), yaw], axis=1))
    simulator.velocity[:] = 0.0
    simulator.velocity[:, 0] = SPEED
    navigation.begin(np.arange(DRAWS), simulator)
    start, way = simulator.pose[:, :3].copy(), np.stack([np.cos(yaw), np.sin(yaw), np.zeros(DRAWS)], axis=1)
    rate, nothing = navigation.rate, np.zeros_like(one._action)
    every = round(rate * one.task.duration)
    for k in range(1, round(KILOMETRE / SPEED * rate) + 1):
        simulator.pose[:, :3] = start + way * (SPEED * k / rate)
        navigation.sample(simulator, 1.0 / rate)
        if k % every == 0:
            one.task.episodes.steps += 1
            navigation.conclude(nothing, nothing, np.zeros(one.n))
    away: Floats = np.linalg.norm(navigation.pose[:, :2] - simulator.pose[:, :2], axis=1)
    return away / KILOMETRE


def drift() -> Iterator[Sequence[str]]:
    """Measure the drift over a straight kilometre."""
    fine = (
        "sensors.dvl.merit_low=0.01",
        "sensors.dvl.merit_high=0.01",
        "navigation.start.position=1e-3",
        "sensors.dvl.mounting=0",
    )
    three = (*TRUE_HEADING[1:], "sensors.heading.bias=0.0524")
    for name, theory, words in (
        ("performance (0.1 %), true heading", "0.1 %", ("sensors.dvl.scale=0.001", *TRUE_HEADING)),
        ("standard (1 %), true heading", "1 %", TRUE_HEADING),
        ("standard (1 %), 3 degrees", "5 %", three),
    ):
        shares = [straight(*fine, *words, f"navigation={kind}") for kind in ("ekf", "dead_reckoning")]
        rms = [f"{100.0 * math.sqrt(float(np.mean(share**2))):.2f} %" for share in shares]
        yield name, theory, *rms


def speed() -> Iterator[Sequence[str]]:
    """Measure the environment steps per second of 1024 environments, with and without an estimator, in turns."""
    ways = {
        "truth": ("sensors=none", "navigation=truth"),
        "ekf": (),
        "ekf, IMU at 100 Hz": ("sensors.imu.rate=100",),
        "ekf_model": ("navigation=ekf_model",),
        "dead_reckoning": ("navigation=dead_reckoning",),
    }
    ready = {name: batch(*words, n=1024) for name, words in ways.items()}
    rng, best = np.random.default_rng(0), dict.fromkeys(ways, math.inf)
    action = rng.uniform(-0.2, 0.2, ready["truth"]._action.shape)
    for turn in range(6):
        for name, one in ready.items():
            begin = time.thread_time()
            for _ in range(5):
                one.step(action)
            if turn > 0:
                best[name] = min(best[name], (time.thread_time() - begin) / 5)
    for name, seconds in best.items():
        yield name, f"{1024 / seconds / 1e3:.0f},000", f"{best['truth'] / seconds:.2f}"


TABLES = {
    "IMU: an hour at rest": (("sensor", "time", "Allan deviation", "theory", "difference"), imu),
    "DVL: four beams, figure of merit 20 mm/s": (
        ("axis", "standard deviation", "theory", "difference"),
        doppler,
    ),
    f"Consistency: {EPISODES} episodes of {SECONDS} s": (
        ("task", "sensors", "NEES", "NIS DVL", "NIS depth", "NIS heading"),
        filters,
    ),
    f"Lost DVL: {LOSS} s, after {KNOWN} s with it": (
        ("water", "`navigation`", "drift (RMS)", "median", "NEES"),
        losses,
    ),
    f"Positions: {DRAWS} trajectories of {LONG} s": (
        ("sensors", "further states", "error (RMS)", "NEES", "NIS USBL"),
        positions,
    ),
    f"Messages: {TEAMS} teams of 60 s, `ekf_model`": (
        ("sensors", "beacons", "ranges", "beacons' error (RMS)", "others'", "others' NEES", "success"),
        messages,
    ),
    "Drift over a straight kilometre": (("DVL and heading", "expected", "`ekf`", "`dead_reckoning`"), drift),
    "Speed: 1024 environments": (("navigation", "steps per second", "of truth"), speed),
}


def table(title: str) -> str:
    """Return a table in Markdown."""
    head, rows = TABLES[title]
    lines = [head, ["---"] * len(head), *rows()]
    return "\n".join([f"**{title}**", "", *(f"| {' | '.join(line)} |" for line in lines), ""])


def renewed(text: str, tables: dict[str, str]) -> str:
    """Return the page's text with new tables by title; the others stay as they are."""
    before, rest = text.split(MARK)
    old, after = rest.split(END)
    kept = {part.split("**", 1)[0]: f"**{part}" for part in ("\n" + old).split("\n**")[1:]}
    both = {**{title: part.rstrip() + "\n" for title, part in kept.items()}, **tables}
    return (
        before
        + MARK
        + "\n"
        + "\n".join(both[title] for title in TABLES if title in both)
        + "\n"
        + END
        + after
    )


def main() -> None:
    """Print the tables, or write them into the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.navigation", description=__doc__)
    parser.add_argument("--write", action="store_true", help="renew docs/navigation.md")
    parser.add_argument("--only", help="first word of a table's title")
    given = parser.parse_args()
    tables = {}
    for title in TABLES:
        if not given.only or title.startswith(given.only):
            tables[title] = table(title)
            print(tables[title], flush=True)
    if not tables:
        parser.error(
            f"--only {given.only}: no such table; use {', '.join(title.split()[0].strip(':') for title in TABLES)}"
        )
    if given.write:
        PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8"), tables), encoding="utf-8")


if __name__ == "__main__":
    main()
