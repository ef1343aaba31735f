"""Run directories with plausible data that nobody trained: what the tests of the report read.

`write_experiment` lays down directories exactly as `auvbench train` and `auvbench evaluate` do. The numbers
come from a small statistical model (a skill per configuration, a difficulty per scenario), are a pure
function of the arguments, and keep what a real run keeps: every agent meets the same scenarios, the columns
agree with each other (rates, sums, distances), failures lie where the task is hard.

    >>> runs = write_experiment(tmp_path / "grid", algorithms=("ppo", "sac", "pid"), seeds=(0, 1))
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from numpy.typing import NDArray

from auvbench.record import record_columns
from auvbench.runs import identity, integrity

FloatArray = NDArray[np.float64]

CLASSICAL = ("pid", "random")
"""Agents with nothing to learn: one run, no training records."""
START = np.array([0.0, 0.0, -20.0])
SUCCESS_RADIUS = 3.0
DEPTH = (-60.0, -1.0)
MAX_STEPS = 1000
ROBUSTNESS = (
    "nominal",
    *(f"level={v}" for v in ("calm", "moderate", "severe")),
    *(f"current={v}" for v in ("0.25", "0.5", "0.75", "1")),
    "dead-thruster",
    *(f"delay={v}" for v in ("0.1", "0.2", "0.3", "0.5")),
    *(f"noise={v}" for v in ("2", "4", "8")),
    *(f"{name}={v}" for name in ("mass", "drag") for v in ("0.7", "1.3")),
)
"""the conditions of conf/protocol/robustness.yaml"""
FREQUENCY_SWEEP = tuple(f"frequency={v}" for v in (10, 25, 55))
TRANSFER = ("nominal", "vehicle=bluerov2", "vehicle=bluerov2-realistic-inertia", "vehicle=bluerov2-wu2018")
"""those that a BlueROV2 meets"""
GAZEBO = ("nominal", "simulator=gazebo", "simulator=gazebo-published")


@dataclass(frozen=True, slots=True)
class Skill:
    """How well one configuration controls the vehicle."""

    success: float  # chance on a scenario of mean difficulty
    collision: float  # share of the failures that are collisions
    speed: float  # m/s made good towards the waypoint
    deviation: float  # m, mean distance from the straight line
    command: float  # N, mean norm of the command
    speed_of_learning: float  # environment steps until half of the final success


@dataclass(frozen=True, slots=True)
class Scenarios:
    """What every agent meets: a start and a waypoint per episode."""

    waypoint: FloatArray  # (E, 3) m
    yaw: FloatArray  # (E,) rad
    difficulty: FloatArray  # (E,) standard normal
    fingerprint: str


def write_experiment(
    root: Path,
    *,
    algorithms: Sequence[str] = ("ppo", "sac", "pid"),
    reward_k: Sequence[float] = (1.0,),
    frequencies: Sequence[float] = (25.0,),
    seeds: Sequence[int] = (0, 1),
    episodes: int = 50,
    protocols: Mapping[str, Sequence[str]] | None = None,
    train_episodes: int = 200,
    trajectories: int = 3,
    vehicle: str = "bluerov2",
) -> list[Path]:
    """Writes one run per cell of the grid and returns their directories, in the order of the grid.

    Args:
        root: the experiment's folder (`outputs/<name>`), created.
        algorithms: names; those of `CLASSICAL` get one run at the first K, the first frequency and seed.
        reward_k: values of `reward.k`.
        frequencies: values of `step.frequency`, Hz.
        seeds: training seeds.
        episodes: test episodes of a condition.
        protocols: conditions by protocol; default `{"test": ("nominal",)}`; see `ROBUSTNESS` for more.
        train_episodes: rows of `train/episodes.csv`; 0 leaves the file out.
        trajectories: episodes whose trajectory is kept, of each condition.
        vehicle: its name; another one meets scenarios of another fingerprint.
    """
    protocols = {"test": ("nominal",)} if protocols is None else protocols
    written = []
    for algo in algorithms:
        classical = algo in CLASSICAL
        for k in reward_k[:1] if classical else reward_k:
            for f in frequencies[:1] if classical else frequencies:
                for seed in seeds[:1] if classical else seeds:
                    run = _write_run(root, algo, float(k), float(f), int(seed), train_episodes, vehicle)
                    for protocol, conditions in protocols.items():
                        write_evaluation(run, protocol, conditions, episodes, trajectories)
                    written.append(run)
    return written


def skill_of(algo: str, k: float, frequency: float, seed: int) -> Skill:
    """The skill of a configuration: falls with K and frequency as the thesis tells, differs by seed."""
    base = {"pid": 0.985, "random": 0.004, "ppo": 0.97, "sac": 0.985, "ddpg": 0.80, "td3": 0.93}.get(
        algo, 0.9
    )
    rng = np.random.default_rng([seed, _number(f"{algo}/{k}/{frequency}")])
    logit = np.log(base / (1 - base))
    if algo not in CLASSICAL:
        logit -= 0.35 * np.log10(max(k, 0.1)) + 0.9 * np.log(frequency / 10) * (1.0 if algo == "ppo" else 0.5)
        logit += rng.normal(0, 0.45)
    success = float(1 / (1 + np.exp(-logit)))
    return Skill(
        success=success,
        collision=0.75 if algo == "random" else float(rng.uniform(0.15, 0.5)),
        speed=0.05 if algo == "random" else 0.45 + 0.45 * success + float(rng.normal(0, 0.03)),
        deviation={"pid": 0.6, "sac": 2.4, "ppo": 3.2}.get(algo, 2.9) * float(rng.uniform(0.85, 1.15)),
        command={"pid": 24.0, "sac": 34.0, "ppo": 38.0}.get(algo, 36.0) * float(rng.uniform(0.94, 1.06)),
        speed_of_learning=float({"sac": 25e3, "ppo": 45e3}.get(algo, 35e3) * (frequency / 10) ** 0.5),
    )


def scenarios(protocol: str, condition: str, episodes: int) -> Scenarios:
    """The scenarios of a condition: a pure function of the arguments."""
    rng = np.random.default_rng([123, _number(f"{protocol}/{condition}")])
    waypoint = np.column_stack(
        [rng.uniform(-20, 20, episodes), rng.uniform(-20, 20, episodes), rng.uniform(*DEPTH, episodes)]
    )
    near_limit = np.minimum(DEPTH[1] - waypoint[:, 2], waypoint[:, 2] - DEPTH[0]) < 4
    difficulty = rng.normal(0, 1, episodes) + 1.6 * near_limit
    yaw = rng.uniform(0, 2 * np.pi, episodes)
    return Scenarios(
        waypoint, yaw, difficulty, hashlib.sha256(waypoint.tobytes() + yaw.tobytes()).hexdigest()[:16]
    )


def write_evaluation(
    run: Path, protocol: str, conditions: Sequence[str], episodes: int, trajectories: int = 3
) -> Path:
    """Writes `evaluations/<protocol>/` of a run that `write_experiment` made."""
    config = read_yaml(run / "config.yaml")
    algo, k, f, seed = (
        config["algo"]["name"],
        config["reward"]["k"],
        config["step"]["frequency"],
        config["seed"],
    )
    skill = skill_of(algo, k, f, seed)
    folder = run / "evaluations" / protocol
    folder.mkdir(parents=True, exist_ok=True)
    frames, summaries, prints = [], [], ""
    arrays: dict[str, NDArray[Any]] = {}
    for condition in conditions:
        world = scenarios(protocol, condition, episodes)
        prints += world.fingerprint
        rng = np.random.default_rng([seed, 7, _number(f"{algo}/{k}/{f}/{protocol}/{condition}")])
        frame = _test_episodes(_weathered(skill, condition), world, k, rng)
        frame.insert(0, "frequency_hz", 10.0)
        frame.insert(0, "condition", condition)
        frames.append(frame)
        summaries.append(_summary_of(condition, frame))
        first = frame.head(trajectories).to_dict("list")
        for e in range(min(trajectories, len(frame))):
            arrays |= _trajectory(condition, {str(name): values[e] for name, values in first.items()}, rng)
    pd.concat(frames).to_csv(folder / "episodes.csv", index=False)
    if config["vehicle"]["name"] != "bluerov2":
        prints += config["vehicle"]["name"]
    fingerprint = hashlib.sha256(prints.encode()).hexdigest()[:16]
    summary = {
        "schema_version": 1,
        "protocol": protocol,
        "fingerprint": fingerprint,
        "conditions": summaries,
        "run": run.name,
        "model": integrity.digests(json.loads((run / "manifest.json").read_text()), "model/"),
        "fingerprint_parts": {"scenarios": fingerprint, "outcomes": fingerprint},
        "scenarios": "test",
        "inference": None,
        "seed": 123,
        "created": "2026-01-01T12:00:00+00:00",
        "versions": {"auvbench": "0.1.0"},
    }
    np.savez(folder / "trajectories.npz", allow_pickle=False, **arrays)
    seal(folder / "summary.json", summary)
    return folder


def reconfigure(run: Path, **values: Any) -> Path:
    """The run as another configuration would have made it: `algo__gamma=0.9` sets algo.gamma. Returns its folder."""
    config = read_yaml(run / "config.yaml")
    for key, value in values.items():
        *groups, last = key.split("__")
        node = config
        for group in groups:
            node = node[group]
        node[last] = value
    write_yaml(run / "config.yaml", config)
    named = run.with_name(identity.run_id(config))
    run.rename(named)
    seal(named / "manifest.json", id=named.name, seed=config["seed"], algo=config["algo"]["name"])
    for summary in named.glob("evaluations/*/summary.json"):
        seal(summary, run=named.name)
    return named


def seal(path: Path, holder: dict[str, Any] | None = None, **changes: Any) -> None:
    """Writes a manifest or summary, or that which is there with changes, with digests of the files it vouches for."""
    holder = (json.loads(path.read_text()) if holder is None else holder) | changes
    names = ("train/episodes.csv",) if path.name == "manifest.json" else ("episodes.csv", "trajectories.npz")
    there = [name for name in names if (path.parent / name).is_file()]
    files = {name: integrity.entry_of(path.parent / name) for name in there}
    path.write_text(json.dumps(integrity.sealed(holder | {"files": files}), indent=2) + "\n")


def read_yaml(path: Path) -> dict[str, Any]:
    config: dict[str, Any] = yaml.load(path.read_text(), Loader=yaml.CSafeLoader)
    return config


def write_yaml(path: Path, config: dict[str, Any]) -> None:
    path.write_text(yaml.dump(config, Dumper=yaml.CSafeDumper, sort_keys=False))


def _number(text: str) -> int:
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "little")


def _weathered(skill: Skill, condition: str) -> Skill:
    """The skill under a condition of the robustness, frequency_sweep or transfer protocol."""
    name, _, text = condition.partition("=")
    value = 0.0 if not text or name in ("level", "vehicle", "simulator") else float(text)
    harm = {
        "level": {"moderate": 0.8, "severe": 2.2}.get(text, 0.0),
        "current": 3.5 * value**2,
        "delay": 6.0 * value,
        "noise": 0.35 * (value - 1),
        "mass": 2.0 * abs(value - 1),
        "drag": 1.0 * abs(value - 1),
        "dead-thruster": 1.5,
        "frequency": 0.04 * (value - 10),
        "vehicle": {"bluerov2-realistic-inertia": 0.3, "bluerov2-wu2018": 4.0}.get(text, 0.0),
    }.get(name, 0.0)
    logit = np.log(skill.success / (1 - skill.success)) - harm
    return Skill(
        success=float(1 / (1 + np.exp(-logit))),
        collision=skill.collision,
        speed=skill.speed / (1 + 0.12 * harm),
        deviation=skill.deviation * (1 + 0.3 * harm),
        command=skill.command,
        speed_of_learning=skill.speed_of_learning,
    )


def _test_episodes(skill: Skill, world: Scenarios, k: float, rng: np.random.Generator) -> pd.DataFrame:
    n = len(world.yaw)
    logit = np.log(skill.success / (1 - skill.success)) - 0.9 * world.difficulty
    chance = 1 / (1 + np.exp(-logit))
    return _rows(skill, chance, world.waypoint, world.yaw, 10.0, k, np.arange(n), np.zeros(n, int), rng)


def _rows(
    skill: Skill,
    chance: FloatArray,
    waypoint: FloatArray,
    yaw: FloatArray,
    frequency: float,
    k: float,
    episode: NDArray[np.int_],
    environment: NDArray[np.int_],
    rng: np.random.Generator,
) -> pd.DataFrame:
    """Rows of episodes.csv, shape (E,), whose columns agree with each other."""
    n = len(yaw)
    distance = np.linalg.norm(waypoint - START, axis=1)
    needed = np.maximum(distance - SUCCESS_RADIUS, 0.5) / skill.speed * rng.lognormal(0, 0.12, n) * frequency
    success = (rng.random(n) < chance) & (needed < MAX_STEPS)
    collision = ~success & (rng.random(n) < skill.collision)
    steps = np.where(success, needed, np.where(collision, rng.uniform(60, 700, n), MAX_STEPS))
    steps = np.clip(steps, 1, MAX_STEPS).astype(int)
    outcome = np.where(success, "success", np.where(collision, "collision", "timeout"))
    duration = steps / frequency
    final = np.where(success, rng.uniform(2.4, 3.0, n), rng.uniform(3.2, 1.0 * distance + 4.0, n))
    deviation = skill.deviation * np.where(success, 1.0, 2.0) * rng.lognormal(0, 0.3, n)
    norm = skill.command * rng.lognormal(0, 0.07, n)
    path = np.where(success, (distance - final) * (1 + 0.05 * deviation), skill.speed * duration * 1.2)
    approach = k * np.exp(-0.5 * (distance + final) / 20) * steps * np.where(success, 0.93, 0.5)
    bonus = (
        np.where(success, 500.0, np.where(collision, -550.0, 0.0)) - np.where(success, 0.07, 0.5) * 10 * steps
    )
    margin = np.minimum(DEPTH[1] - waypoint[:, 2], waypoint[:, 2] - DEPTH[0]) * rng.uniform(0.5, 1, n)
    frame = pd.DataFrame(
        {
            "episode": episode,
            "environment": environment,
            "outcome": outcome,
            "steps": steps,
            "duration_s": duration,
            "return": approach + bonus,
            "initial_distance_m": distance,
            "final_distance_m": final,
            "deviation_mean_m": deviation,
            "deviation_std_m": deviation * rng.uniform(0.4, 0.6, n),
            "command_norm_mean_N": norm,
            "command_norm_sum_N": norm * steps,
            "energy_J": 2.1 * norm**1.3 * duration,
            "path_length_m": path,
            "path_efficiency": np.clip((distance - final) / path, 0, 1),
            "smoothness_per_s": rng.lognormal(0.5, 0.3, n),
            "depth_margin_m": np.where(collision, -rng.uniform(0, 0.05, n), margin),
            "waypoint_x_m": waypoint[:, 0],
            "waypoint_y_m": waypoint[:, 1],
            "waypoint_z_m": waypoint[:, 2],
            "start_yaw_rad": yaw,
        }
    )
    return frame[list(record_columns("waypoint"))]


def _training(skill: Skill, frequency: float, k: float, n: int, environments: int, seed: int) -> pd.DataFrame:
    """n rows of training with a success that grows as a sigmoid of the steps."""
    rng = np.random.default_rng([seed, 11, _number(f"{skill}")])
    waypoint = np.column_stack([rng.uniform(-20, 20, n), rng.uniform(-20, 20, n), rng.uniform(*DEPTH, n)])
    progress = np.linspace(0, 4 * skill.speed_of_learning, n)
    learned = 1 / (1 + np.exp(-(progress - skill.speed_of_learning) / (0.25 * skill.speed_of_learning)))
    frame = _rows(
        skill,
        skill.success * learned,
        waypoint,
        rng.uniform(0, 2 * np.pi, n),
        frequency,
        k,
        np.arange(n) // environments,
        np.arange(n) % environments,
        rng,
    )
    frame.insert(0, "step", np.cumsum(frame["steps"].to_numpy()))
    return frame


def _write_run(
    root: Path, algo: str, k: float, f: float, seed: int, train_episodes: int, vehicle: str
) -> Path:
    config = _config(root.name, algo, k, f, seed)
    config["vehicle"]["name"] = vehicle
    run = root / identity.run_id(config)
    for folder in ("train", "checkpoints", "model", "evaluations"):
        (run / folder).mkdir(parents=True, exist_ok=True)
    write_yaml(run / "config.yaml", config)
    steps, success, rows = 0, None, 0
    if algo not in CLASSICAL and train_episodes:
        frame = _training(skill_of(algo, k, f, seed), f, k, train_episodes, config["algo"]["n_envs"], seed)
        frame.to_csv(run / "train" / "episodes.csv", index=False)
        steps, rows = int(frame["step"].iloc[-1]), len(frame)
        success = float((frame["outcome"].tail(100) == "success").mean())
    seal(run / "manifest.json", _manifest(run.name, algo, seed, steps, rows, success))
    return run


def _config(name: str, algo: str, k: float, f: float, seed: int) -> dict[str, Any]:
    return {
        "seed": seed,
        "name": name,
        "output": "outputs",
        "vehicle": {"name": "bluerov2", "mass": 10.0, "thruster": {"lag": 0.1, "limits": [-40.0, 40.0]}},
        "simulator": {"name": "fossen", "max_step": 0.01, "threads": 1},
        "task": {
            "name": "waypoint",
            "start": START.tolist(),
            "waypoint_low": [-20.0, -20.0, DEPTH[0]],
            "waypoint_high": [20.0, 20.0, DEPTH[1]],
            "goal_radius": SUCCESS_RADIUS,
            "depth_low": DEPTH[0],
            "depth_high": DEPTH[1],
            "max_steps": MAX_STEPS,
        },
        "reward": {"name": "thesis", "k": k, "success": 500.0, "collision": -550.0, "regress": -10.0},
        "step": {"frequency": f},
        "noise": {"sensor": [0.05, 0.1], "command": [0.01, 0.05]},
        "disturbance": {"name": "none", "current": 0.0, "delay": 0.0},
        "algo": {"name": algo, "n_envs": 32, "learning_rate": 3e-4, "batch_size": 256, "gamma": 0.99},
        "train": {"total_steps": 100000, "checkpoint": {"steps": 50000, "seconds": 600}, "progress": True},
        "launcher": {"name": "local", "workers": 2},
    }


def _manifest(run: str, algo: str, seed: int, steps: int, rows: int, success: float | None) -> dict[str, Any]:
    return {
        "schema_version": 1,
        "id": run,
        "state": "complete",
        "steps": steps,
        "total_steps": steps,
        "episodes": rows,
        "success_rate": success,
        "seed": seed,
        "algo": algo,
        "created": "2026-01-01T10:00:00+00:00",
        "started": "2026-01-01T10:00:01+00:00",
        "ended": "2026-01-01T10:01:31+00:00",
        "wall_time_s": 90.0,
        "cpu_time_s": 90.0,
        "phases": {},
        "error": None,
        "versions": {"auvbench": "0.1.0", "python": "3.11.7"},
        "git": {"commit": "0" * 40, "dirty": False},
        "host": {"name": "host", "cpu": "cpu", "cores": 2, "threads": 1},
        "command": "auvbench train",
        "attempts": 1,
    }


def _summary_of(condition: str, frame: pd.DataFrame) -> dict[str, Any]:
    return {
        "name": condition,
        "frequency_hz": 10.0,
        "max_steps": MAX_STEPS,
        "episodes": len(frame),
        "success_rate": float((frame["outcome"] == "success").mean()),
        "collision_rate": float((frame["outcome"] == "collision").mean()),
        "timeout_rate": float((frame["outcome"] == "timeout").mean()),
        "mean_steps": float(frame["steps"].mean()),
    }


def _trajectory(condition: str, row: Mapping[str, Any], rng: np.random.Generator) -> dict[str, NDArray[Any]]:
    """A smooth path of `steps` steps from the start to where the episode ended."""
    steps = int(row["steps"])
    waypoint = np.array([row["waypoint_x_m"], row["waypoint_y_m"], row["waypoint_z_m"]])
    line = waypoint - START
    end = waypoint - line / np.linalg.norm(line) * row["final_distance_m"]
    if row["outcome"] == "collision":
        end = np.array([*end[:2], DEPTH[1] + 0.05 if waypoint[2] > -30 else DEPTH[0] - 0.05])
    s = np.linspace(0, 1, steps + 1)
    bow = sum(
        (
            rng.normal(0, 1.6 * row["deviation_mean_m"] / m, 3) * np.sin(np.pi * m * s)[:, None]
            for m in (1, 2, 3)
        ),
        start=np.zeros((steps + 1, 3)),
    )
    position = START + s[:, None] * (end - START) + bow
    position[:-1, 2] = np.clip(position[:-1, 2], DEPTH[0] + 0.1, DEPTH[1] - 0.1)
    command = rng.normal(0, row["command_norm_mean_N"] / np.sqrt(6), (steps, 6))
    key = f"{condition}_{int(row['episode'])}"
    return {
        f"position_{key}": position,
        f"yaw_{key}": row["start_yaw_rad"] + np.cumsum(rng.normal(0, 0.02, steps + 1)),
        f"command_{key}": command,
        f"waypoint_{key}": waypoint,
        f"time_{key}": np.arange(steps + 1) / 10.0,
    }


def damage(path: Path, kind: str) -> None:
    """Harms a file of a run the way real ones get harmed.

    Args:
        path: the file.
        kind: `cut` (the last row ends half way), `column` (a column is gone), `nan` (a return is nan),
            `schema` (a JSON file of another schema version).
    """
    text = path.read_text()
    if kind == "cut":
        path.write_text(text[: text.rindex("\n", 0, len(text) - 1) + 40])
    elif kind == "column":
        pd.read_csv(path).drop(columns="duration_s").to_csv(path, index=False)
    elif kind == "nan":
        frame = pd.read_csv(path)
        frame.loc[len(frame) // 2, "return"] = np.nan
        frame.to_csv(path, index=False)
    elif kind == "schema":
        path.write_text(json.dumps(integrity.sealed(json.loads(text) | {"schema_version": 99})))
    else:
        raise ValueError(f"unknown kind of damage: {kind!r}")


def set_state(runs: Iterable[Path], state: str, error: str | None = None) -> None:
    """Rewrites the manifests of some runs to another state."""
    for run in runs:
        manifest = json.loads((run / "manifest.json").read_text())
        manifest["state"] = state
        if error:
            manifest["error"] = {"type": "TrainingError", "message": error, "step": 1000, "traceback": ""}
        seal(run / "manifest.json", manifest)
