"""Packages that are installed for one test: modules and metadata in a folder on the path, as pip leaves them."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.util import cache_from_source
from pathlib import Path

import pytest

from auvbench import registry


@dataclass
class Site:
    """A folder of installed packages.

    Args:
        folder: on the path of this process and of those it starts.
    """

    folder: Path
    modules: set[str] = field(default_factory=set)

    def install(
        self,
        package: str,
        files: Mapping[str, str],
        *,
        agents: Mapping[str, str] | None = None,
        tasks: Mapping[str, str] | None = None,
        rewards: Mapping[str, str] | None = None,
        points: Mapping[str, Mapping[str, str]] | None = None,
        conf: str | None = None,
        version: str = "1.0",
    ) -> None:
        """Writes modules and YAML files by their paths, and the entry points; takes the place of another version.

        Args:
            points: entry points of further groups.
        """
        self.uninstall(package)
        for path, text in files.items():
            place = self.folder / path
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(textwrap.dedent(text))
            # Python takes a source of the same second and size for the one whose bytecode it kept.
            Path(cache_from_source(str(place))).unlink(missing_ok=True)
            self.modules.add(path.split("/", 1)[0].removesuffix(".py"))
        groups = {"auvbench.agents": agents or {}}
        groups |= {"auvbench.tasks": tasks or {}, "auvbench.rewards": rewards or {}}
        groups |= points or {}
        groups["auvbench.conf"] = {} if conf is None else {package: conf}
        info = self.folder / f"{package.replace('-', '_')}-{version}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n")
        lines = [
            line
            for group, points in groups.items()
            for line in (f"[{group}]", *(f"{name} = {value}" for name, value in points.items()))
        ]
        (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
        self.look_again()

    def uninstall(self, package: str) -> None:
        """Takes away the metadata, as far as there is any; modules stay and are not found by anybody."""
        for info in self.folder.glob(f"{package.replace('-', '_')}-*.dist-info"):
            for file in info.iterdir():
                file.unlink()
            info.rmdir()
        self.look_again()

    def look_again(self) -> None:
        for name in [n for n in sys.modules if n.partition(".")[0] in self.modules]:
            del sys.modules[name]
        registry.forget()


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    made = Site(tmp_path / "site")
    made.folder.mkdir()
    monkeypatch.syspath_prepend(made.folder)
    monkeypatch.chdir(tmp_path)
    # Where a grid is carried out, its workers must find them too.
    monkeypatch.setenv("PYTHONPATH", str(made.folder))
    yield made
    monkeypatch.undo()
    made.look_again()


STEERING = """
    from dataclasses import dataclass
    import numpy as np
    from auvbench.plugin import AgentConfig, number

    @dataclass(kw_only=True)
    class MineConfig(AgentConfig):
        gain: float = number(0.0, 10.0, open_low=True)
        patience: int = number(1, 1_000_000)

    class Mine:
        Config = MineConfig

        def __init__(self, config, vehicle):
            self.n_u = len(vehicle.actuators)
            self.gain = config.algo.gain

        def reset(self, episodes):
            pass

        def act(self, observation):
            return np.tanh(self.gain * observation[:, 1:2] * np.ones(self.n_u))
"""
"""An agent that steers, as the text of a module."""

MINE = """
    name: mine
    agent: mine
    n_envs: 1
    gain: 0.5
    patience: 3
"""
"""Its algo/mine.yaml."""


def steering(site: Site, act: str = "", *, package: str = "mine-package", version: str = "1.0") -> None:
    """Installs `algo=mine`; `act` is the body of its `act` where it is to be another one."""
    text = textwrap.dedent(STEERING)
    if act:
        head = text[: text.index("        return np.tanh")]
        text = head + textwrap.indent(textwrap.dedent(act).strip(), "        ") + "\n"
    site.install(
        package,
        {"mine/__init__.py": "", "mine/steering.py": text, "mine/conf/algo/mine.yaml": MINE},
        agents={"mine": "mine.steering:Mine"},
        conf="mine.conf",
        version=version,
    )


LEARNING = """
    import json
    import numpy as np
    from auvbench.plugin import Components

    class Slow:
        exact_resume = {exact}

        def __init__(self, config, vehicle):
            self.n_u = len(vehicle.actuators)
            self.steered = 0
            self.generator = np.random.default_rng(config.seed)
            self.sum = 0.0

        def reset(self, episodes):
            pass

        def act(self, observation):
            return np.full((len(observation), self.n_u), np.tanh(self.sum))

        def learn(self, environment, config, callbacks):
            steps = callbacks.begin()
            while steps < callbacks.total_steps:
                callbacks.checkpoint(steps)
                environment.reset()
                for _ in range(10):
                    {action}
                    result = environment.step(action)
                    steps += environment.n
                    callbacks.step(steps, result)
                    self.sum += float(result.reward.mean()) * 1e-4
                callbacks.log({{"slow/sum": self.sum}}, steps)

        def save(self, folder):
            (folder / "sum.json").write_text(json.dumps(self.sum))

        def load(self, folder):
            self.sum = json.loads((folder / "sum.json").read_text())

        def state(self):
            return Components(values={{"slow": [self.sum, self.generator.bit_generator.state]}})

        def restore(self, components):
            self.sum, self.generator.bit_generator.state = components.values["slow"]
"""
DRAWN = "action = self.generator.uniform(-1.0, 1.0, (environment.n, self.n_u))"

SLOW = """
    name: slow
    agent: slow
    n_envs: 4
"""


def learning(site: Site, *, exact: bool = True, action: str = DRAWN) -> None:
    """Installs `algo=slow`, which learns next to nothing."""
    text = LEARNING.format(exact=exact, action=action)
    site.install(
        "slow-package",
        {"slow/__init__.py": "", "slow/learning.py": text, "slow/conf/algo/slow.yaml": SLOW},
        agents={"slow": "slow.learning:Slow"},
        conf="slow.conf",
    )


EXAMPLE = Path(__file__).parents[1] / "examples" / "auvbench-example"


def tasking(site: Site, *changes: tuple[str, str], version: str = "1.0") -> None:
    """Installs `task=circling` and `reward=view` of the example; each change replaces a text of its files."""
    root = EXAMPLE / "auvbench_example"
    names = ("__init__.py", "circling.py", "view.py", "conf/task/circling.yaml", "conf/reward/view.yaml")
    files = {f"auvbench_example/{name}": (root / name).read_text(encoding="utf-8") for name in names}
    for old, new in changes:
        assert any(old in text for text in files.values()), old
        files = {name: text.replace(old, new) for name, text in files.items()}
    site.install(
        "auvbench-example",
        files,
        tasks={"circling": "auvbench_example.circling:SPEC"},
        rewards={"view": "auvbench_example.view:SPEC"},
        conf="auvbench_example.conf",
        version=version,
    )
