"""Draw the pictures of the documentation (`make gallery`): PID in the first test episode of each task, vehicles, the race."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from auvbench import cli
from auvbench.config.tasks import TASKS
from benchmarks import hero, vehicle_pictures

ASSETS = Path(__file__).parents[1] / "docs" / "assets"
COLOURS = 64
"""of a picture: a third of the bytes, and no difference to see"""


def main() -> None:
    """Train, replay and store, task by task."""
    for task in TASKS:
        with TemporaryDirectory() as folder:
            words = [f"task={task}", "algo=pid", "vehicle=bluerov2_heavy", f"output={folder}"]
            if code := cli.main(["train", *words]) or cli.main(["replay", folder, "--out", folder]):
                raise SystemExit(code)
            with Image.open(Path(folder) / "test-nominal-0.png") as picture:
                small = picture.convert("RGB").quantize(
                    COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
                )
                small.save(ASSETS / f"task-{task}.png", optimize=True)
    vehicle_pictures.main()
    hero.main()


if __name__ == "__main__":
    main()
