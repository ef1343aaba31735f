"""Packed paths are the same to a millimetre, in a fifth of the room; what is no such file is refused."""

from __future__ import annotations

import io
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvbench.analysis import packed_paths
from auvbench.analysis.evaluations import Damage
from auvbench.analysis.paths import paths
from tests.synthetic import seal


def drawn(dtype: Any, *conditions: str) -> dict[str, Any]:
    rng = np.random.default_rng(1)
    found: dict[str, Any] = {}
    for condition in conditions:
        for episode in (10, 2, 0):
            n = 50 + episode
            found |= {
                f"position_{condition}_{episode}": np.cumsum(rng.normal(0, 0.05, (n, 3)), axis=0).astype(
                    dtype
                ),
                f"time_{condition}_{episode}": (np.arange(n) * 0.1).astype(dtype),
                f"waypoint_{condition}_{episode}": rng.normal(size=3).astype(dtype),
            }
    return found


def summarised(folder: Path) -> None:
    """Writes the summary that paths are compared with."""
    seal(folder / "summary.json", {"schema_version": 1, "fingerprint": "f", "conditions": []})


def opened(data: bytes) -> dict[str, Any]:
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        return dict(archive)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_same_paths_in_the_order_of_the_episodes(dtype: Any) -> None:
    arrays = drawn(dtype, "nominal", "current_x=0.5")
    arrays["position_nominal_2"][3] = [-54321.0, -0.0, 1e-5]
    again = opened(packed_paths.pack(arrays))
    assert packed_paths.holds(list(again))
    for condition in ("nominal", "current_x=0.5"):
        found = list(packed_paths.unpack(again, condition))
        assert [episode for episode, *_ in found] == [0, 2, 10]
        for episode, waypoint, position, time in found:
            assert waypoint.tobytes() == arrays[f"waypoint_{condition}_{episode}"].tobytes()
            wanted = arrays[f"position_{condition}_{episode}"].astype(np.float64)
            np.testing.assert_allclose(position, wanted, rtol=0, atol=0.5001e-3)
            wanted = arrays[f"time_{condition}_{episode}"].astype(np.float64)
            np.testing.assert_allclose(time, wanted, rtol=0, atol=0.5001e-6)
    assert list(packed_paths.unpack(again, "other")) == []


def test_a_file_is_read_in_the_units_that_it_names() -> None:
    again = opened(packed_paths.pack(drawn(np.float32, "nominal")))
    (_, _, wanted, _), *_ = packed_paths.unpack(again, "nominal")
    (_, _, found, _), *_ = packed_paths.unpack(again | {"units": again["units"] / 10}, "nominal")
    np.testing.assert_allclose(found, wanted / 10)


def test_packed_once_more_they_are_the_same_bits() -> None:
    again = opened(packed_paths.pack(drawn(np.float32, "nominal")))
    kept = {}
    for episode, waypoint, position, time in packed_paths.unpack(again, "nominal"):
        kept |= {
            f"position_nominal_{episode}": position,
            f"time_nominal_{episode}": time,
            f"waypoint_nominal_{episode}": waypoint,
        }
    twice = opened(packed_paths.pack(kept))
    assert again.keys() == twice.keys()
    assert all(again[name].tobytes() == twice[name].tobytes() for name in again)


@pytest.mark.parametrize("value", [np.nan, -np.inf, 1e9])
def test_what_is_no_place_is_refused(value: float) -> None:
    arrays = drawn(np.float32, "nominal")
    arrays["position_nominal_2"][3, 1] = value
    with pytest.raises(ValueError, match="position_nominal_2 and its times are not finite"):
        packed_paths.pack(arrays)


def test_they_take_less_room() -> None:
    stream = io.BytesIO()
    arrays = drawn(np.float32, "nominal")
    np.savez_compressed(stream, **arrays)
    assert len(packed_paths.pack(arrays)) < 0.7 * len(
        stream.getvalue()
    )  # a drunken walk: a vehicle's has a third


def test_paths_reads_both(tmp_path: Path) -> None:
    arrays = drawn(np.float32, "nominal")
    for name, data in (("plain", None), ("packed", packed_paths.pack(arrays))):
        (tmp_path / name).mkdir()
        if data is None:
            np.savez_compressed(tmp_path / name / "trajectories.npz", **arrays)
        else:
            (tmp_path / name / "trajectories.npz").write_bytes(data)
        summarised(tmp_path / name)
    one, other = (list(paths(tmp_path / n / "trajectories.npz", "nominal", 2)) for n in ("plain", "packed"))
    assert [p[0] for p in one] == [p[0] for p in other] == [0, 2]
    for a, b in zip(one, other, strict=True):
        assert a[1] == b[1]
        np.testing.assert_allclose(a[2], b[2], rtol=0, atol=0.5001e-3)
        np.testing.assert_allclose(a[3], b[3], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("changes_nominal", np.zeros((4, 5, 4))),
        ("changes_nominal", np.zeros((9, 162, 4), dtype=np.uint8)),
        ("changes_nominal", np.zeros((4, 161, 4), dtype=np.uint8)),
        ("points_nominal", np.array([50, 52])),
        ("points_nominal", np.array([0, 102, 60])),
        ("points_nominal", np.array(["a", "b", "c"])),
        ("episodes_nominal", np.zeros((3, 2))),
        ("waypoints_nominal", np.zeros((3, 2))),
        ("waypoints_nominal", None),
        ("units", None),
        ("units", np.full(3, 1e-3)),
        ("units", np.array([1e-3, 1e-3, 0.0, 1e-6])),
        ("units", np.array([1e-3, np.nan, 1e-3, 1e-6])),
        ("units", np.array(["m", "m", "m", "s"])),
    ],
)
def test_damage_is_named(tmp_path: Path, name: str, value: Any) -> None:
    arrays = opened(packed_paths.pack(drawn(np.float32, "nominal"))) | {name: value}
    np.savez(tmp_path / "trajectories.npz", **{k: v for k, v in arrays.items() if v is not None})
    (tmp_path / "summary.json").write_text("{}")
    with pytest.raises(Damage, match=r"trajectories\.npz cannot be read"):
        list(paths(tmp_path / "trajectories.npz", "nominal", 10))


def test_a_small_file_does_not_fill_the_memory(tmp_path: Path) -> None:
    n = 20_000_000
    named = {"units": packed_paths.UNITS, "episodes_a": np.array([0]), "points_a": np.array([n])}
    arrays = named | {"waypoints_a": np.zeros((1, 3)), "changes_a": np.zeros((1, n, 4), dtype=np.uint8)}
    file = tmp_path / "trajectories.npz"
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    assert file.stat().st_size < 100_000
    tracemalloc.start()
    try:
        with pytest.raises(Damage, match="positions"):
            list(paths(file, "a", 3))
        assert tracemalloc.get_traced_memory()[1] < 4 * n * 4
    finally:
        tracemalloc.stop()


def test_paths_are_floating_point_numbers(tmp_path: Path) -> None:
    arrays = drawn(np.float32, "a")
    file = tmp_path / "trajectories.npz"
    np.savez_compressed(file, **(arrays | {"position_a_0": np.zeros((50, 3), dtype=np.int8)}))
    with pytest.raises(Damage, match="floating-point"):
        list(paths(file, "a", 3))
