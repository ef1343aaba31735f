"""Attitude and axes; round trips are searched by hypothesis in tests/verification."""

from __future__ import annotations

import numpy as np
import pytest

from auvbench.dynamics import frames


def test_euler_of_known_turns() -> None:
    h = np.sqrt(0.5)
    np.testing.assert_allclose(frames.euler([[h, h, 0, 0], [h, 0, 0, h], [1, 0, 0, 0]]), [[np.pi / 2, 0, 0], [0, 0, np.pi / 2], [0, 0, 0]], atol=1e-15)  # fmt: skip


def test_euler_at_a_quarter_turn_of_pitch_is_exact() -> None:
    h = np.sqrt(0.5)
    assert frames.euler([h, 0, h, 0])[1] == pytest.approx(np.pi / 2, abs=1e-7)


def test_quaternion_of_angles_is_z_y_x() -> None:
    phi, theta, psi = 0.3, -0.4, 1.2
    c, s = np.cos, np.sin
    Rz = np.array([[c(psi), -s(psi), 0], [s(psi), c(psi), 0], [0, 0, 1]])
    Ry = np.array([[c(theta), 0, s(theta)], [0, 1, 0], [-s(theta), 0, c(theta)]])
    Rx = np.array([[1, 0, 0], [0, c(phi), -s(phi)], [0, s(phi), c(phi)]])
    np.testing.assert_allclose(
        frames.rotation(frames.quaternion([phi, theta, psi])), Rz @ Ry @ Rx, atol=1e-15
    )


def test_half_turn_changes_signs_of_y_and_z() -> None:
    assert frames.flip([1, 2, 3, 4, 5, 6]).tolist() == [1, -2, -3, 4, -5, -6]
    # Nose up in NED (positive pitch) is nose up in ENU (negative pitch).
    up = np.concatenate([np.zeros(3), frames.quaternion([0.1, 0.2, 0.3])])
    np.testing.assert_allclose(frames.euler(frames.flip_pose(up)[3:]), [0.1, -0.2, -0.3])
