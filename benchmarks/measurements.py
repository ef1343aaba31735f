"""The measurements of `make bench`. Each function returns rows (what, number, unit, remark)."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Hashable, Iterator, Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np

from auvbench.agents import base as agents
from auvbench.config.compose import compose
from auvbench.config.schema import TrainConfig
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.envs.simulator_factory import make_simulator
from auvbench.registry import TASKS
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles import sheet
from auvbench.vehicles.reader import sheet_names
from benchmarks import tuning
from benchmarks.offpolicy import offpolicy
from benchmarks.ros2 import ros2
from benchmarks.timing import best, command, loop_rate
from benchmarks.worlds import worlds

Row = tuple[str, str, str, str]
K = TypeVar("K", bound=Hashable)
FREQUENCY = 25.0
SUBSTEPS = 4  # of 0.01 s in one step at 25 Hz


def configuration(*overrides: str) -> TrainConfig:
    return train_config(compose("train", overrides))


def _stepper(batch: Batch, clock: Callable[[], float] = time.perf_counter) -> float:
    """Return the seconds of one step of a batch: noise, physics, observation, reward, automatic reset."""
    rng = np.random.default_rng(0)
    actions = [rng.uniform(-1, 1, (batch.n, len(batch.vehicle.actuators))) for _ in range(8)]
    batch.reset()
    turn = [0]

    def step() -> None:
        turn[0] += 1
        batch.step(actions[turn[0] % 8])

    return best(step, seconds=1.0, clock=clock)


def _fastest(batches: Mapping[K, Batch]) -> dict[K, float]:
    """Return the processor seconds of one step of each batch, measured alternately, since the load of a machine changes."""
    rounds = [{name: _stepper(batch, time.thread_time) for name, batch in batches.items()} for _ in range(3)]
    return {name: min(seconds[name] for seconds in rounds) for name in batches}


def environments() -> Iterator[Row]:
    """Measure the full environment step."""
    for n in (1, 32, 1024):
        batch = Batch(configuration(f"step.frequency={FREQUENCY}"), n)
        seconds = _stepper(batch)
        yield (
            f"environment steps, N = {n}, one thread",
            f"{n / seconds:,.0f}",
            "steps/s",
            f"{1e6 * seconds:.1f} µs a batch step, {n / seconds / FREQUENCY:,.0f} times real time",
        )


def tasks() -> Iterator[Row]:
    """Measure the processor time of the full environment step of each task."""
    n, vehicle = 1024, "bluerov2_heavy"
    yield (
        "plain Python, `for i in range(n): x += i * 0.5`",
        f"{loop_rate() / 1e6:.1f}",
        "million turns/s",
        "to compare machines",
    )
    words = f"vehicle={vehicle}", f"step.frequency={FREQUENCY}"
    batches = {task: Batch(configuration(f"task={task}", *words), n) for task in TASKS}
    rates = {task: n / seconds for task, seconds in _fastest(batches).items()}
    for task, rate in rates.items():
        yield (
            f"environment steps, {task}, {vehicle}, N = {n}",
            f"{rate:,.0f}",
            "steps/s",
            f"processor time; {rate / rates['waypoint']:.2f} times waypoint",
        )


def teams() -> Iterator[Row]:
    """Compare the processor time of one vehicle's step in a team of four with that in a team of one."""
    for rows in (4, 256, 1024):
        words = "task=formation", "vehicle=bluerov2_heavy", f"step.frequency={FREQUENCY}"
        batches = {
            size: Batch(configuration(*words, f"task.vehicles={size}"), rows // size) for size in (1, 4)
        }
        one, four = (seconds / rows for seconds in _fastest(batches).values())
        yield (
            f"vehicle step in a team of four, formation, N = {rows}",
            f"{four / one:.2f}",
            "times alone",
            f"processor time; {1e6 * four:.2f} and {1e6 * one:.2f} µs",
        )


def planners() -> Iterator[Row]:
    """Measure the processor time of an action of agents that plan, in one episode of the default task."""
    for name in ("pid", "mpc", "mppi"):
        config = configuration(f"algo={name}", "algo.n_envs=1")
        batch = Batch(config, 1, validation=True)
        agent = agents.make(config, batch.vehicle)
        observation = batch.reset()
        agent.reset(np.arange(1))
        agent.act(observation)  # loads what is compiled
        agent.reset(np.arange(1))
        times = []
        for _ in range(100):
            begun = time.thread_time()
            action = agent.act(observation)
            times.append(1e3 * (time.thread_time() - begun))
            observation = batch.step(action).observation
        yield (
            f"an action of {name}, one vehicle, median of 100",
            f"{statistics.median(times):.1f}",
            "ms",
            f"processor time; at most {max(times[1:]):.1f} ms, the first {times[0]:.0f} ms",
        )


def threads() -> Iterator[Row]:
    """Measure how much faster a large batch is with a second thread."""
    for n in (1024, 4096, 8192):
        one, two = (
            _stepper(Batch(configuration(f"step.frequency={FREQUENCY}", f"simulator.threads={t}"), n))
            for t in (1, 2)
        )
        yield (
            f"environment steps, N = {n}, two threads",
            f"{n / two:,.0f}",
            "steps/s",
            f"{one / two:.2f} times one thread",
        )


def disturbances() -> Iterator[Row]:
    """Measure the processor time of the environment step with each disturbance, alternately."""
    n, names = 1024, ("none", "current", "waves", "severe", "tether")
    batches = {
        name: Batch(configuration(f"step.frequency={FREQUENCY}", f"disturbance={name}"), n) for name in names
    }
    fastest = _fastest(batches)
    for name in names[1:]:
        yield (
            f"environment steps, disturbance={name}, N = {n}, one thread",
            f"{n / fastest[name]:,.0f}",
            "steps/s",
            f"processor time; {fastest['none'] / fastest[name]:.2f} of the rate without disturbances",
        )


def vehicles() -> Iterator[Row]:
    """Measure the physics of every vehicle, without a task."""
    n = 1024
    for name in sheet_names():
        vehicle = sheet.load(name)
        simulator = make_simulator(configuration().simulator, vehicle, n)
        simulator.reset(np.arange(n), np.tile([0, 0, -20, 1, 0, 0, 0], (n, 1)), np.zeros((n, 6)))
        action = np.random.default_rng(0).uniform(-0.5, 0.5, (n, len(vehicle.actuators)))
        seconds = best(lambda s=simulator, a=action: s.step(a, 1 / FREQUENCY), seconds=0.7)
        yield (
            f"physics alone, {name}, N = {n}",
            f"{n / seconds:,.0f}",
            "steps/s",
            f"{n / seconds / FREQUENCY:,.0f} times real time",
        )


def reference() -> Iterator[Row]:
    """Compare the kernel's speed with the plain NumPy implementation of the same equations in tests/reference."""
    from tests.reference.fossen import constant, simulate, state_at
    from tests.reference.vehicles import BLUEROV2

    times = np.array([0.0, 1 / FREQUENCY])
    start = state_at(position=(0, 0, -20), nu=(0.5, 0.1, 0.1, 0.05, 0.05, 0.1))
    plain = best(lambda: simulate(BLUEROV2, start, times, constant(np.ones(6)), step=0.01), seconds=0.7)
    vehicle = sheet.load("bluerov2")
    for n in (1, 1024):
        simulator = FossenSimulator(vehicle, n)
        simulator.reset(np.arange(n), np.tile([0, 0, -20, 1, 0, 0, 0], (n, 1)), np.zeros((n, 6)))
        action = np.full((n, 6), 0.3)
        seconds = best(lambda s=simulator, a=action: s.step(a, 1 / FREQUENCY), seconds=0.5) / n
        yield (
            f"physics against plain NumPy, N = {n}",
            f"{plain / seconds:,.0f}",
            "times",
            f"NumPy {1e6 * plain:.0f} µs, kernel {1e6 * seconds:.2f} µs for one vehicle and one step",
        )


def learners() -> Iterator[Row]:
    """Measure training with the default presets, as `auvbench train` does it, without compilation and set-up."""
    from auvbench.runs.directory import RunDirectory
    from auvbench.runs.plan import prepare
    from auvbench.training.execute import execute

    for algo, steps in (("ppo", 102_400), ("sac", 8_000)):
        with tempfile.TemporaryDirectory() as folder:
            overrides = [f"algo={algo}", f"output={folder}", f"train.total_steps={steps}"]
            run: RunDirectory = prepare(compose("train", overrides))
            manifest = execute(run)
            seconds = manifest["phases"]["training_s"]
            yield (
                f"training, {algo.upper()}, defaults, one core",
                f"{manifest['steps'] / seconds:,.0f}",
                "steps/s",
                f"{manifest['steps']:,} steps in {seconds:.1f} s",
            )


def record() -> Iterator[Row]:
    """Measure `algo=ppo_fast`: the training of a policy that passes the test, and the rest of the command."""
    from auvbench.config.validate import evaluate_config
    from auvbench.evaluation.evaluate import evaluate
    from auvbench.runs.plan import prepare
    from auvbench.training.execute import execute

    protocol = evaluate_config(compose("evaluate")).protocol
    times, rates, around = [], [], []
    for seed in range(100, 105):  # seeds that were not used to choose the preset
        with tempfile.TemporaryDirectory() as folder:
            overrides = ["algo=ppo_fast", "train.total_steps=61440", f"seed={seed}", f"output={folder}"]
            run = prepare(compose("train", overrides))
            begun = time.perf_counter()
            phases = execute(run)["phases"]
            around.append(time.perf_counter() - begun - phases["training_s"])
            times.append(phases["training_s"])
            rates.append(100 * evaluate(run, protocol)["conditions"][0]["success_rate"])
    yield (
        "ppo_fast, 61,440 steps, one core, median of five seeds",
        f"{statistics.median(times):.2f}",
        "s",
        f"test success {statistics.median(rates):.1f} % (median; {min(rates):.1f} to {max(rates):.1f}); "
        f"{min(times):.2f} to {max(times):.2f} s",
    )
    yield (
        "ppo_fast, making the run and keeping it, median",
        f"{statistics.median(around):.2f}",
        "s",
        "environment, learner, files; not in the figure above",
    )
    seconds = command("train", "algo=ppo_fast", "train.total_steps=61440", fresh=True, repetitions=3)
    yield (
        "auvbench train algo=ppo_fast, the whole command",
        f"{seconds:.1f}",
        "s",
        "start-up of the process, too",
    )


def evaluation() -> Iterator[Row]:
    """Measure the test protocol."""
    from auvbench.config.validate import evaluate_config
    from auvbench.evaluation.evaluate import evaluate
    from auvbench.runs.plan import prepare
    from auvbench.training.execute import execute

    protocol = evaluate_config(compose("evaluate")).protocol
    small = ["train.total_steps=4096"]
    for algo, extra in (("pid", []), ("ppo", small)):
        with tempfile.TemporaryDirectory() as folder:
            run = prepare(compose("train", [f"algo={algo}", f"output={folder}", *extra]))
            execute(run)
            evaluate(run, protocol)
            begun = time.perf_counter()
            summary = evaluate(run, protocol)
            seconds = time.perf_counter() - begun
            steps = sum(c["mean_steps"] * c["episodes"] for c in summary["conditions"])
            yield (
                f"test protocol, {algo.upper()}, 500 episodes",
                f"{seconds:.2f}",
                "s",
                f"{steps:,.0f} environment steps{'' if algo == 'pid' else ' (barely trained: long episodes)'}",
            )


def commands() -> Iterator[Row]:
    """Measure whole commands, with the start of Python and all imports."""
    yield ("auvbench --help", f"{1e3 * command('--help'):.0f}", "ms", "")
    yield ("auvbench train --cfg job", f"{1e3 * command('train', '--cfg', 'job'):.0f}", "ms", "")


def again() -> Iterator[Row]:
    """Measure commands typed again after all runs are complete: they check each run and train none."""
    runs = 50
    with tempfile.TemporaryDirectory() as folder:
        typed = {
            "train -m": ("train", "-m", "algo=pid", f"seed=range({runs})", f"output={folder}"),
            "evaluate": ("evaluate", folder, "protocol.episodes=10"),
            "resume": ("resume", folder),
        }
        for name in ("train -m", "evaluate"):
            command(*typed[name], repetitions=1)
        for name, words in typed.items():
            yield (f"auvbench {name}, typed again, {runs} complete runs", f"{command(*words):.2f}", "s", "")


def reports() -> Iterator[Row]:
    """Measure a whole report of many synthetic runs, in all formats and with all figures."""
    from tests.synthetic import write_experiment

    with tempfile.TemporaryDirectory() as folder:
        runs = write_experiment(
            Path(folder),
            algorithms=("ppo", "sac", "ddpg", "td3"),
            reward_k=(1, 10, 40, 70, 100),
            frequencies=(10, 25, 40, 50, 55),
            seeds=range(10),
            episodes=500,
            train_episodes=200,
        )
        seconds = command("report", folder, repetitions=3)
    yield (f"auvbench report, {len(runs)} runs x 500 episodes", f"{seconds:.1f}", "s", "figures included")


SECTIONS = {
    "environments": environments,
    "tasks": tasks,
    "teams": teams,
    "planners": planners,
    "threads": threads,
    "disturbances": disturbances,
    "vehicles": vehicles,
    "reference": reference,
    "learners": learners,
    "offpolicy": offpolicy,
    "record": record,
    "evaluation": evaluation,
    "ros2": ros2,
    "commands": commands,
    "again": again,
    "reports": reports,
    "tuning": tuning.study,
    "worlds": worlds,
}


def machine() -> str:
    """Return one line that describes the machine."""
    from auvbench.runs.provenance import host, versions

    facts, installed = host(), versions()
    model = Path("/proc/cpuinfo").read_text(encoding="utf-8") if Path("/proc/cpuinfo").exists() else ""
    clock = next((line.split(":")[1].strip() for line in model.splitlines() if "cpu MHz" in line), "")
    speed = f" at {float(clock) / 1000:.1f} GHz" if clock else ""
    return (
        f"{facts['cpu']}{speed}, {facts['cores']} cores; Python {installed['python']}, numba {installed['numba']}, "
        f"NumPy {installed['numpy']}, torch {installed['torch']}"
    )
