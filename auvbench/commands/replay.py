"""`auvbench replay RUN`: run one episode of a test again, and show it as text, figure and film."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.commands import trust
from auvbench.commands.grammar import Parser
from auvbench.errors import RunError

if TYPE_CHECKING:
    from auvbench.evaluation.replay import Replay


def parser() -> Parser:
    parser = Parser(
        prog="auvbench replay",
        description="Run one episode of a test again, with the same result, and show it.",
    )
    parser.add_argument(
        "run", type=Path, metavar="RUN", help="a run directory, or a folder of `auvbench pilot --record`"
    )
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
        help="a moving picture as well: FILE.gif (default: next to the figure)",
    )
    parser.add_argument(trust.FLAG, action="store_true", help=trust.HELP)
    return parser


def main(arguments: Sequence[str]) -> int:
    options = parser().read(arguments)
    if options.video not in (None, Path()):
        from auvbench.reporting import replay_pictures

        replay_pictures.check(options.video)  # before anything is computed
    from auvbench.evaluation.replay import is_mission, read_mission, replay

    if is_mission(options.run):
        return _show(
            read_mission(options.run, options.episode),
            (options.out or options.run / "replays") / f"mission-{options.episode}",
            options.video,
        )
    from auvbench.config.compose import compose
    from auvbench.config.validate import evaluate_config
    from auvbench.runs.directory import find_runs

    runs = find_runs([options.run])
    if len(runs) != 1:
        raise RunError(f"{options.run}: holds {len(runs)} runs; name one of them, e.g. {runs[0].path}")
    trust.require_runs(runs, options.trust, "replay", packages=True)
    protocol = evaluate_config(compose("evaluate", [f"protocol={options.protocol}"])).protocol
    condition = options.condition or protocol.conditions[0].name
    episode = replay(runs[0], protocol, condition, options.episode)
    folder = options.out or runs[0].path / "replays"
    # The name may hold dots: current=0.5.
    return _show(episode, folder / f"{protocol.name}-{condition}-{options.episode}", options.video)


def _show(episode: Replay, stem: Path, video: Path | None) -> int:
    """Print the episode, draw `stem`.png and .svg, and make a film if `video` is given."""
    from auvbench.reporting.replay_pictures import draw, summary
    from auvbench.runs.atomic_io import storage

    print(summary(episode))
    with storage(f"cannot write into {stem.parent}"):
        png, svg = draw(episode, stem)
    print(f"\nwrote {png}\nwrote {svg}", flush=True)
    if video is not None:
        target = video if video != Path() else stem.with_name(f"{stem.name}.gif")
        with storage(f"cannot write {target}"):
            _film(episode, target)
    return 0


def _film(episode: Replay, target: Path) -> None:
    from auvbench.commands.progress import work_bar
    from auvbench.reporting.replay_pictures import film

    with work_bar(f"film {target.name}", "pictures") as tell:
        film(episode, target, tell)
    print(f"wrote {target}")
