"""Compressed tables: read in place of the plain ones, the same bytes each time, bounded, and refused when damaged."""

import bz2

import pytest

from auvbench.untrusted import bz2_io


def test_the_plain_file_comes_first(tmp_path):
    (tmp_path / "a.csv.bz2").write_bytes(bz2_io.packed(b"packed"))
    assert bz2_io.content(tmp_path / "a.csv", 100) == b"packed"
    (tmp_path / "a.csv").write_bytes(b"plain")
    assert bz2_io.content(tmp_path / "a.csv", 100) == b"plain"


def test_neither_is_there(tmp_path):
    assert bz2_io.beside(tmp_path / "a.csv") is None
    with pytest.raises(FileNotFoundError, match=r"a\.csv"):
        bz2_io.content(tmp_path / "a.csv", 100)


def test_the_same_content_gives_the_same_bytes_that_anybody_reads():
    data = b"condition,episode\n" * 1000
    assert bz2_io.packed(data) == bz2_io.packed(data)
    assert bz2.decompress(bz2_io.packed(data)) == data


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"no bzip2", "no sound bzip2"),
        (bz2_io.packed(b"x" * 50)[:-3], "cut short"),
        (bz2_io.packed(b"x" * 50) + b"more", "something follows"),
        (bz2_io.packed(b"x" * 101), "more than 100 bytes"),
        (bz2_io.packed(b"\0" * 10**8), "more than 100 bytes"),
    ],
)
def test_what_is_refused(data, said):
    with pytest.raises(ValueError, match=said):
        bz2_io.unpacked(data, 100)


def test_a_flipped_bit_is_noticed():
    data = bytearray(bz2_io.packed(b"condition,episode\n0,1\n" * 40))
    data[len(data) // 2] ^= 4
    with pytest.raises(ValueError, match="bzip2"):
        bz2_io.unpacked(bytes(data), 10**6)
