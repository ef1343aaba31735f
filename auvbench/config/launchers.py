"""The schemas of the `launcher` group: where the runs of a grid are carried out. Neutral for their results."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.schema import choice, number


@dataclass(kw_only=True)
class Launcher:
    """What every launcher has."""

    name: str = choice("local", "slurm", "ray")


@dataclass(kw_only=True)
class Local(Launcher):
    """Processes of this machine."""

    workers: int = number(0, 100_000)


@dataclass(kw_only=True)
class Slurm(Launcher):
    """Jobs of a SLURM cluster."""

    workers: int = number(0, 1_000_000)
    partition: str | None
    account: str | None
    time: str | None
    mem: str | None
    cpus: int = number(1, 4096)
    signal_before: int = number(1, 65_535)  # s; sbatch takes no more
    poll: float = number(0.1, 3600.0)  # s
    grace: float = number(0.0, 3600.0)  # s
    setup: list[str]
    sbatch: list[str]


@dataclass(kw_only=True)
class Ray(Launcher):
    """Tasks of a Ray cluster."""

    workers: int = number(0, 1_000_000)
    address: str | None
    cpus: float = number(0.0, 4096.0, open_low=True)
    memory: int = number(0, 1 << 40)  # MiB


SCHEMAS: dict[str, type] = {
    "launcher_local_schema": Local,
    "launcher_slurm_schema": Slurm,
    "launcher_ray_schema": Ray,
}
