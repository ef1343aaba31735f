from __future__ import annotations

from pathlib import Path

import numpy as np
from stable_baselines3.common.logger import Logger

from auvbench.agents.learned.sb3 import Scalars
from auvbench.training.checkpoint.logs import NAME, EventWriter, GrowingLog, cut
from tests.soak.learning import scalars


def write(folder: Path, steps: range) -> Path:
    writer = EventWriter(folder)
    logger = Logger(None, [Scalars(writer.write)])
    for step in steps:
        logger.record("train/loss", np.float32(1.0 / (step + 1)))
        logger.record("rollout/count", step)
        logger.record("hidden", 1.0, exclude="tensorboard")
        logger.record("text", "not a scalar")
        logger.dump(step)
    logger.close()
    writer.close()
    return folder / NAME


def test_scalars_read_back_as_tensorboard_reads_them(tmp_path: Path) -> None:
    write(tmp_path / "train", range(5))
    found = scalars(tmp_path)
    assert set(found) == {"train/loss", "rollout/count"}
    assert found["train/loss"] == [(step, float(np.float32(1.0 / (step + 1)))) for step in range(5)]


def test_a_cut_file_goes_on_without_gaps_or_doubles(tmp_path: Path) -> None:
    write(tmp_path / "whole/train", range(20))
    path = write(tmp_path / "cut/train", range(8))
    mark = GrowingLog(path).mark()
    write(tmp_path / "cut/train", range(8, 13))  # lost: written after the mark
    with path.open("ab") as file:
        file.write(b"half a reco")  # torn by a kill
    cut(path, mark.bytes)
    write(tmp_path / "cut/train", range(8, 20))
    assert scalars(tmp_path / "cut") == scalars(tmp_path / "whole")
    assert len(list((tmp_path / "cut/train").iterdir())) == 1


def test_cutting_to_nothing_removes_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, range(2))
    cut(path, 0)
    assert not path.exists()
    cut(path, 0)
