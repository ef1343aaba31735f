"""The power goes: whatever a manifest or a summary vouches for is there, and every run goes on to the same bits."""

from __future__ import annotations

import json
import random
import shutil
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.runs import integrity
from auvbench.runs.directory import RunDirectory
from auvbench.training.execute import execute
from tests.conftest import Trained
from tests.soak.bits import bits
from tests.soak.campaign import frozen
from tests.soak.power import LOSSES, Disk

CASE = "ppo-1"
BRIEF = ["protocol.episodes=6", "protocol.trajectories=2", "--workers", "1"]


def kept(folder: Path, run: RunDirectory, image: Path) -> RunDirectory:
    return RunDirectory(image / run.path.relative_to(folder))


def vouched_for(run: RunDirectory) -> None:
    """Everything that a manifest or summary of the run speaks of is there as it was written."""
    holders = [run.manifest_path, *run.path.glob("evaluations/*/summary.json")]
    for path in holders:
        holder = json.loads(path.read_text())
        assert integrity.broken_seal(holder) == ""
        assert integrity.lacking(path.parent, holder) == ""


def test_the_disk_forgets_what_was_not_synced(tmp_path: Path) -> None:
    """The instrument itself: a file without fsync, one whose name was not synced, and one that is safe."""
    folder = tmp_path / "disk"
    folder.mkdir()
    (folder / "old").write_text("old")
    from auvbench.runs.atomic_io import write_atomic

    with Disk(folder) as disk:
        (folder / "unsynced").write_text("text")
        (folder / "old").write_text("new, unsynced")
        write_atomic(folder / "unnamed", b"text", sync_folder=False)
        found = {loss: disk.image(tmp_path / loss, loss) for loss in LOSSES[:3]}
        write_atomic(folder / "safe", b"text")
        safe = disk.image(tmp_path / "safe", "everything")
    everything, contents, zeros = found.values()
    assert {p.name: p.read_bytes() for p in everything.iterdir()} == {"old": b"old"}
    assert {p.name: p.read_bytes() for p in contents.iterdir()} == {
        "old": b"old",
        "unsynced": b"",
        "unnamed": b"text",
    }
    assert (zeros / "unsynced").read_bytes() == b"\0\0\0\0"
    assert (safe / "safe").read_bytes() == b"text"
    assert (safe / "unsynced").read_bytes() == b""  # its name was synced with the folder, its content was not


@pytest.fixture(scope="module")
def whole(trained: Trained) -> dict[str, str]:
    return bits(trained(CASE).path)


@pytest.mark.slow
def test_a_run_that_ended_stands_a_cut(tmp_path: Path, whole: dict[str, str]) -> None:
    folder = tmp_path / "disk"
    folder.mkdir()
    with Disk(folder) as disk:
        run = frozen(folder, "cut", CASE, ["train.checkpoint.steps=100"])
        execute(run)
        images = [disk.image(tmp_path / loss, loss) for loss in LOSSES]
    for image in images:
        left = kept(folder, run, image)
        assert left.manifest()["state"] == "complete"
        vouched_for(left)
        assert bits(left.path) == whole


@pytest.mark.slow
def test_a_cut_at_any_moment_costs_at_most_a_part_of_the_training(
    tmp_path: Path, whole: dict[str, str]
) -> None:
    folder, rng = tmp_path / "disk", random.Random(4)
    folder.mkdir()
    images: list[Path] = []
    with Disk(folder) as disk:

        def strike(_operation: str) -> None:
            if rng.random() < 0.08:
                images.append(disk.image(tmp_path / f"cut-{len(images)}", rng.choice(LOSSES), rng))

        disk.before = strike
        run = frozen(folder, "cut", CASE, ["train.checkpoint.steps=100"])
        execute(run)
    assert len(images) >= 4
    for image in images[:8]:
        # The same command again, in whatever is left.
        again = frozen(image, "cut", CASE, ["train.checkpoint.steps=100"])
        if again.manifest()["state"] == "complete":
            vouched_for(again)
        execute(again)
        assert bits(again.path) == whole, image
        shutil.rmtree(image)


@pytest.mark.slow
def test_an_evaluation_and_a_report_stand_a_cut(tmp_path: Path) -> None:
    folder = tmp_path / "disk"
    run = frozen(folder, "tested", CASE, [])
    execute(run)
    images: list[Path] = []
    with Disk(folder) as disk:

        def strike(operation: str) -> None:
            if operation == "rename":
                images.append(disk.image(tmp_path / f"cut-{len(images)}", LOSSES[len(images) % 3]))

        disk.before = strike
        assert cli.main(["evaluate", str(folder), *BRIEF]) == 0
        disk.before = None
        images += [disk.image(tmp_path / f"tested-{loss}", loss) for loss in LOSSES]
        assert cli.main(["report", str(folder), "--format", "html,csv,md"]) == 0
        reported = [disk.image(tmp_path / f"reported-{loss}", loss) for loss in LOSSES]
    rows = (run.evaluation("test") / "episodes.csv").read_bytes()
    for image in images:
        left = kept(folder, run, image)
        vouched_for(left)
        if image.name.startswith("cut"):
            # The lock's holder, this process, lives; after a real cut it is of an earlier boot.
            shutil.rmtree(left.path / "evaluations" / ".test", ignore_errors=True)
            assert cli.main(["evaluate", str(image), *BRIEF]) == 0
        assert (left.evaluation("test") / "episodes.csv").read_bytes() == rows
    written = folder / "tested" / "report"
    expected = {p.relative_to(written): p.read_bytes() for p in written.rglob("*") if p.is_file()}
    assert len(expected) > 5
    for image in reported:
        report = image / "tested" / "report"
        assert {p.relative_to(report): p.read_bytes() for p in report.rglob("*") if p.is_file()} == expected
