"""Draw the pictures of the documentation (`make gallery`): PID in the first test episode of each task, vehicles, the race."""

from __future__ import annotations

import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from auvbench import cli
from auvbench.registry import TASKS
from benchmarks import field_film, hero, vehicle_pictures, world_pictures

ASSETS = Path(__file__).parents[1] / "docs" / "assets"
RESULTS = Path(__file__).parents[1] / "results"
COLOURS = 64
"""colours of a picture: a third of the bytes, without a visible difference"""


def main() -> None:
    """Train and replay PID on each task, and store the pictures."""
    for task in TASKS:
        with TemporaryDirectory() as folder:
            words = [f"task={task}", "algo=pid", "vehicle=bluerov2_heavy", f"output={folder}"]
            if code := cli.main(["train", *words]) or cli.main(["replay", folder, "--out", folder]):
                raise SystemExit(code)
            _store(Path(folder) / "test-nominal-0.png", f"task-{task}.png")
    _page()
    vehicle_pictures.main()
    world_pictures.main()
    hero.main()
    field_film.main()


def _page() -> None:
    """Store a Chromium screenshot of the top of the published leaderboard's page."""
    with TemporaryDirectory() as folder:
        if code := cli.main(["report", str(RESULTS / "leaderboard"), "--out", folder]):
            raise SystemExit(code)
        shot = Path(folder) / "shot.png"
        flags = ["--headless", "--no-sandbox", "--hide-scrollbars", "--virtual-time-budget=8000"]
        size = "--window-size=1200,1000"
        page = (Path(folder) / "index.html").as_uri()
        subprocess.run(["chromium", *flags, size, f"--screenshot={shot}", page], check=True)
        _store(shot, "page.png")


def _store(source: Path, name: str) -> None:
    with Image.open(source) as picture:
        small = picture.convert("RGB").quantize(
            COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
        )
        small.save(ASSETS / name, optimize=True)


if __name__ == "__main__":
    main()
