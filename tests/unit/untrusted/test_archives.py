"""Archives that say they hold more than they do, or unpack without an end."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest
import torch

from auvbench.untrusted import archives, sandbox


def npz(**arrays: object) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)  # type: ignore[arg-type]
    return stream.getvalue()


def bomb(member: str, declared: int) -> bytes:
    """Zeros: some thousandths of what they unpack to."""
    stream = io.BytesIO()
    with (
        zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open(member, "w", force_zip64=True) as file,
    ):
        zeros = bytes(2**20)
        for _ in range(declared // len(zeros)):
            file.write(zeros)
    return stream.getvalue()


def test_arrays_and_weights_come_back() -> None:
    assert archives.arrays(npz(a=np.arange(3)))["a"].tolist() == [0, 1, 2]
    stream = io.BytesIO()
    torch.save({"w": torch.ones(2)}, stream)
    assert archives.weights(stream.getvalue())["w"].tolist() == [1.0, 1.0]


@pytest.mark.slow
def test_a_compressed_bomb_is_not_unpacked(monkeypatch: pytest.MonkeyPatch) -> None:
    data = bomb("a.npy", 2**30)
    assert len(data) < 8 * 2**20
    for read in (archives.arrays, archives.weights):
        with pytest.raises(ValueError, match=r"would unpack to 1,073,741,824 bytes"):
            read(data)
    monkeypatch.setattr(sandbox, "MEMORY", 2**26)
    stream = io.BytesIO()
    np.savez_compressed(stream, a_nominal_0=np.zeros(2**24))
    with pytest.raises(ValueError, match="more than 64 MiB of memory"):
        archives.paths(stream.getvalue(), "nominal", 1)


def test_an_array_of_a_declared_terabyte_is_refused() -> None:
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (137438953472,), }"
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(
            "a.npy", b"\x93NUMPY\x01\x00" + (len(header) + 1).to_bytes(2, "little") + header + b"\n"
        )
    with pytest.raises(ValueError, match=r"memory|allocate|read"):
        archives.arrays(stream.getvalue())


@pytest.mark.parametrize("data", [b"", b"PK", b"not an archive", npz(a=np.ones(9))[:-30]])
def test_what_is_no_archive_is_said(data: bytes) -> None:
    for read in (archives.arrays, archives.weights):
        with pytest.raises(ValueError, match=r"."):
            read(data)


def test_objects_are_not_unpickled() -> None:
    stream = io.BytesIO()
    np.savez(stream, a=np.array([{}], dtype=object))
    with pytest.raises(ValueError, match="pickle"):
        archives.arrays(stream.getvalue())


def test_weights_are_a_dictionary() -> None:
    stream = io.BytesIO()
    torch.save(torch.ones(1), stream)
    with pytest.raises(ValueError, match="instead of named tensors"):
        archives.weights(stream.getvalue())
