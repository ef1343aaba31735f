"""`auvbench replay RUN...`: repeat one test episode, and show it as text, figure and film."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.errors import ConfigError, RunError, UserError
from auvbench.grammar import Parser, whole

if TYPE_CHECKING:
    from auvbench.evaluation.replay import Replay


def parser() -> Parser:
    parser = Parser(
        prog="auvbench replay",
        description="Repeats one test episode, with the same result as in the test, and shows the episode.",
    )
    parser.add_argument(
        "runs",
        nargs="+",
        type=Path,
        metavar="RUN",
        help="run directory, or a folder of `auvbench pilot --record`; several runs are drawn in one scene",
    )
    parser.add_argument(
        "--episode",
        type=whole(0, 10**9),
        default=0,
        help="number of the episode in the protocol (default: 0)",
    )
    parser.add_argument("--protocol", default="test", help="name of the protocol (default: test)")
    parser.add_argument("--condition", help="test condition (default: the first condition of the protocol)")
    parser.add_argument("--out", type=Path, help="folder for the figure (default: the run's replays/)")
    parser.add_argument(
        "--video",
        type=Path,
        nargs="?",
        const=Path(),
        help="write a film as well: FILE.gif (default: next to the figure)",
    )
    parser.add_argument(
        "--signals",
        type=Path,
        nargs="?",
        const=Path(),
        metavar="FILE",
        help="write position, attitude, velocities, commands, forces, power and all that the agent observed, step by step: FILE.png,"
        " FILE.svg or FILE.csv (default: .png and .csv next to the figure); only for a single run",
    )
    return parser


def main(arguments: Sequence[str]) -> int:
    options = parser().read(arguments)
    if options.video not in (None, Path()):
        from auvbench.reporting import replay_pictures

        replay_pictures.check(options.video)  # raises an error for a wrong suffix before anything is computed
    if options.signals is not None:
        _check_signals(options.signals, options.runs)
    from auvbench.evaluation.replay import is_mission, read_mission, replay

    first = options.runs[0]
    if len(options.runs) == 1 and is_mission(first):
        return _show(
            [read_mission(first, options.episode)],
            (options.out or first / "replays") / f"mission-{options.episode}",
            options.video,
            options.signals,
        )
    from auvbench.config.compose import compose
    from auvbench.config.validate import evaluate_config
    from auvbench.runs.directory import find_runs

    runs = []
    for path in options.runs:
        candidates = find_runs([path])
        if len(candidates) != 1:
            raise RunError(f"{path}: has {len(candidates)} runs; name one of them, e.g. {candidates[0].path}")
        runs += candidates
    try:
        protocol = evaluate_config(compose("evaluate", [f"protocol={options.protocol}"])).protocol
    except ConfigError as error:
        _, _, wrong = str(error).partition(": ")  # drops the key, which the user did not type
        raise UserError(f"--protocol {options.protocol}: {wrong}") from error
    condition = options.condition or protocol.conditions[0].name
    episodes = [replay(run, protocol, condition, options.episode) for run in runs]
    folder = options.out or runs[0].path / "replays"
    # A condition's name may contain dots: current=0.5.
    stem = folder / f"{protocol.name}-{condition}-{options.episode}"
    return _show(episodes, stem, options.video, options.signals)


def _check_signals(path: Path, runs: Sequence[Path]) -> None:
    """Raise UserError unless `--signals` is possible: one run, not a pilot's mission, and a valid suffix."""
    from auvbench.evaluation.replay import is_mission
    from auvbench.reporting import signal_pictures

    if len(runs) > 1:
        raise UserError(f"--signals: shows one run, and {len(runs)} are named; name one")
    if is_mission(runs[0]):
        raise UserError(f"--signals: {runs[0]} has missions of a pilot, which record only path and commands")
    if path != Path():
        signal_pictures.check(path)


def _show(episodes: Sequence[Replay], stem: Path, video: Path | None, signals: Path | None) -> int:
    """Print the episodes, draw `stem`.png and .svg, write a film if `video` is given, and signals if `signals` is given."""
    from auvbench.reporting import replay_pictures, signal_pictures
    from auvbench.runs.atomic_io import storage

    print("\n\n".join(replay_pictures.summary(episode) for episode in episodes))
    with storage(f"cannot write into {stem.parent}"):
        png, svg = replay_pictures.draw(episodes, stem)
    print(f"\nwrote {png}\nwrote {svg}", flush=True)
    if video is not None:
        target = video if video != Path() else stem.with_name(f"{stem.name}.gif")
        with storage(f"cannot write {target}"):
            replay_pictures.film(episodes, target)
        print(f"wrote {target}")
    for target in _signal_files(stem, signals):
        episode = episodes[0]
        assert episode.signals is not None
        about = f"{episode.run}   {episode.protocol} {episode.condition} episode {episode.record['episode']}: {episode.record['outcome']}"
        with storage(f"cannot write {target}"):
            signal_pictures.write(episode.signals, target, about)
        print(f"wrote {target}")
    return 0


def _signal_files(stem: Path, path: Path | None) -> tuple[Path, ...]:
    if path is None:
        return ()
    if path != Path():
        return (path,)
    return tuple(stem.with_name(f"{stem.name}-signals{kind}") for kind in (".png", ".csv"))
