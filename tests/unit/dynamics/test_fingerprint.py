"""The key of the compiled code's cache follows the sources."""

from auvbench.dynamics.fingerprint import fingerprint


def test_fingerprint_follows_content_and_names(tmp_path):
    (tmp_path / "a.py").write_text("x = 1\n")
    first = fingerprint(tmp_path)
    assert first == fingerprint(tmp_path)
    assert 0 <= first < 2**60
    (tmp_path / "a.py").write_text("x = 2\n")
    assert fingerprint(tmp_path) != first
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert fingerprint(tmp_path) != first
