"""The matrix that looks from a point to another, by what a camera with it sees."""

import numpy as np
import pytest

import rle_splat as rs


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, 5.0, 0.1), (1.0, 2.0, -3.0)])
def test_the_target_lies_ahead_and_up_is_up(up):
    eye, target = np.array((1.0, -2.0, 0.5)), np.array((-3.0, 4.0, 2.0))
    matrix = rs.look_at(eye, target, up)
    to_camera = np.linalg.inv(matrix)
    assert np.allclose(to_camera @ (*target, 1.0), (0.0, 0.0, -np.linalg.norm(target - eye), 1.0))
    x, y, _ = to_camera[:3, :3] @ up
    assert abs(x) < 1e-12 < y
    assert np.allclose(matrix[:3, :3].T @ matrix[:3, :3], np.eye(3)) and np.linalg.det(matrix) > 0.0


def test_it_is_the_camera_of_a_turntable():
    volume = rs.Volume(np.ones((8, 10, 12), np.uint8), np.eye(4))
    camera, _ = rs.turntable(volume, azimuth=30.0, elevation=20.0)
    middle = np.array((5.5, 4.5, 3.5))
    assert np.allclose(rs.look_at(camera.matrix_world[:3, 3], middle), camera.matrix_world)


@pytest.mark.parametrize("given", [
    ((1, 2, 3), (1, 2, 3)), ((0, 0, 0), (0, 0, 2)), ((0, 0, np.nan), (1, 0, 0)), ((0, 0), (1, 0, 0)),
    ((0, 0, 0), (1, 0, 0), (0, 0, 0)), ("eye", (1, 0, 0)),
], ids=["same", "along up", "nan", "two numbers", "no up", "text"])  # fmt: skip
def test_what_is_no_view_is_refused(given):
    with pytest.raises(rs.RleSplatError, match="look_at"):
        rs.look_at(*given)
