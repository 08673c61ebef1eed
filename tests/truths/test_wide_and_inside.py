"""Proves that every camera holds: inside the volume, on its faces and slices, very wide, shifted, clipped."""

from itertools import pairwise

import numpy as np
import pytest

from rle_splat.accuracy.phantoms import FIELDS

FIELD = 0.4 * FIELDS["smooth"](24)
FINE = dict(depth_rule="gauss2", sheet_density=2.0, termination=1 / 65536)


def lens_of(fov):
    """Focal length that sees ``fov`` degrees across a 36 mm sensor."""
    return 18.0 / np.tan(np.radians(0.5 * fov))


def error(stage, camera, size=(64, 64), **knobs):
    return stage.error(stage.before(stage.volume(FIELD), camera, size), **(FINE | knobs))


@pytest.mark.parametrize("eye", [
    (11.3, 10.2, 12.1),  # anywhere
    (11.0, 10.0, 12.0),  # on a voxel, so on three slices at once
    (11.5, 10.5, 12.5),  # between slices on all three axes
    (-1.0, 10.3, 12.2),  # on the outermost face of the ramps
    (0.0, 10.3, 12.2),  # on the face of the grid
    (23.0, 23.0, 23.0),  # on a corner
], ids=str)
@pytest.mark.parametrize("fov", [60.0, 120.0, 170.0])
def test_eye_in_or_on_the_volume(stage, eye, fov):
    """RMSE stays that of outside views at every field of view, the six pyramids and their seams included."""
    camera = stage.looking(eye, (13.7, 14.1, 10.4), lens=lens_of(fov), clip_start=1e-4, clip_end=1e3)
    found = error(stage, camera)
    assert found.rmse < 0.3 and found.largest < 4.0


@pytest.mark.parametrize("shift", [(5.0, 0.0), (-5.0, 0.0), (0.0, 5.0), (0.0, -5.0), (1.5, -2.5)])
@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_lens_shift(stage, shift, kind):
    """A camera shifted by several sensor widths, moved aside so that the volume stays in the picture.

    It looks along an axis at matter cut by the faces, where the kinks of all slices fall on the same pixels: the
    worst case of the warp, hence the bound; every shift must give the same error, as it gives the same rays.
    """
    size = 40.0
    distance = 50.0
    sideways = np.array((shift[0] * size, 0.0, shift[1] * size))
    eye = np.array((12.0, 12.0 - distance, 12.0)) - sideways
    camera = stage.looking(
        eye, eye + (0.0, 1.0, 0.0), type=kind, ortho_scale=size, lens=36.0 * distance / size, shift_x=shift[0],
        shift_y=shift[1], clip_start=0.1, clip_end=1e4, pixel_aspect=(1.0, 2.0),
    )
    found = error(stage, camera, (64, 32))
    assert found.rmse < (0.8 if kind == "ORTHO" else 0.3) and found.largest < 12.0


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("clip", [(20.0, 26.5), (0.1, 24.3), (25.7, 500.0)])
def test_clip_planes_inside(stage, kind, clip):
    camera = stage.looking(
        (-14.0, -1.0, 20.0), (12.0, 12.0, 11.0), type=kind, lens=40.0, ortho_scale=34.0, clip_start=clip[0],
        clip_end=clip[1],
    )
    found = error(stage, camera)
    assert found.rmse < 0.5 and found.largest < 6.0


def test_no_mirrored_ghost_behind_the_eye(stage):
    """Matter behind the eye never shows: a bright block at the back leaves the picture of the front unchanged."""
    empty = np.zeros((24, 24, 24))
    behind = empty.copy()
    behind[:, :8] = 0.5
    behind[12, 20, 12] = empty[12, 20, 12] = 0.5
    camera = stage.looking((12.0, 11.0, 12.0), (12.0, 20.0, 12.0), lens=lens_of(100.0), clip_start=1e-3, clip_end=1e3)
    pictures = [
        stage.render(stage.before(stage.volume(field), camera, (48, 48)), **FINE).rgba for field in (empty, behind)
    ]
    assert pictures[0].max() > 0.05
    np.testing.assert_array_equal(pictures[0], pictures[1])


def test_moving_the_eye_across_a_slice_is_continuous(stage):
    scene = lambda y: stage.before(  # noqa: E731
        stage.volume(FIELD), stage.looking((11.2, y, 12.4), (12.0, 40.0, 12.0), lens=20.0, clip_start=1e-4), (48, 48)
    )
    pictures = [stage.render(scene(9.0 + d), **FINE).rgba for d in (-2e-3, -5e-4, 0.0, 5e-4, 2e-3)]
    steps = [np.abs(b - a).max() for a, b in pairwise(pictures)]
    assert max(steps) < 1.0 / 255.0
