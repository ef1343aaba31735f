"""Define the launchers of clusters: their schemas and their specs."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.fields import number
from auvbench.config.launchers import Launcher, LauncherSpec


@dataclass(kw_only=True)
class Slurm(Launcher):
    """Jobs of a SLURM cluster."""

    workers: int = number(0, 1_000_000)
    partition: str | None
    account: str | None
    time: str | None
    mem: str | None
    cpus: int = number(1, 4096)
    signal_before: int = number(1, 65_535)  # s; sbatch accepts no larger value
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


slurm = LauncherSpec("slurm", "auvbench.integrations.cluster.slurm:make", Slurm)
ray = LauncherSpec("ray", "auvbench.integrations.cluster.ray:make", Ray)
