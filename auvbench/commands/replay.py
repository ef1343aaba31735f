"""`auvbench replay RUN`: one episode of a test once more, on the terminal, as a figure, as a film."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.commands.grammar import Parser
from auvbench.errors import RunError

if TYPE_CHECKING:
    from auvbench.evaluation.replay import Replay


def parser() -> Parser:
    parser = Parser(
        prog="auvbench replay",
        description="Runs one episode of a test once more (its row is the same) and shows it.",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="a run directory")
    parser.add_argument("--episode", type=int, default=0, help="episode of the protocol (default: 0)")
    parser.add_argument("--protocol", default="test", help="protocol (default: test)")
    parser.add_argument("--condition", default=None, help="condition (default: the protocol's first)")
    parser.add_argument(
        "--out", type=Path, default=None, help="folder of the figure (default: the run's replays/)"
    )
    parser.add_argument(
        "--video",
        type=Path,
        nargs="?",
        const=Path(),
        help="a film as well: FILE.mp4 (needs ffmpeg) or FILE.gif (default: a GIF beside the figure)",
    )
    return parser


def main(arguments: Sequence[str]) -> int:
    options = parser().read(arguments)
    if options.video not in (None, Path()):
        from auvbench.reporting import film

        film.check(options.video)  # before anything is computed
    from auvbench.config.compose import compose
    from auvbench.config.validate import evaluate_config
    from auvbench.evaluation.replay import replay
    from auvbench.runs.directory import find_runs
    from auvbench.runs.durable import storage

    runs = find_runs([options.run])
    if len(runs) != 1:
        raise RunError(f"{options.run}: holds {len(runs)} runs; name one of them, e.g. {runs[0].path}")
    protocol = evaluate_config(compose("evaluate", [f"protocol={options.protocol}"])).protocol
    condition = options.condition or protocol.conditions[0].name
    episode = replay(runs[0], protocol, condition, options.episode)

    from auvbench.reporting.replay import draw, summary

    print(summary(episode))
    folder = options.out or runs[0].path / "replays"
    stem = folder / f"{protocol.name}-{condition}-{options.episode}"  # may hold dots: current=0.5
    with storage(f"cannot write into {folder}"):
        png, svg = draw(episode, stem)
    print(f"\nwrote {png}\nwrote {svg}", flush=True)
    if options.video is not None:
        target = options.video if options.video != Path() else stem.with_name(f"{stem.name}.gif")
        with storage(f"cannot write {target}"):
            _film(episode, target)
    return 0


def _film(episode: Replay, target: Path) -> None:
    from auvbench.commands.bars import work_bar
    from auvbench.reporting.film import film

    with work_bar(f"film {target.name}", "pictures") as tell:
        film(episode, target, tell)
    print(f"wrote {target}")
