"""Meshes that touch a surface cast their shadow on it: against geometry, and against the reference of light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.scene import Camera, Quality, Scene
from rle_splat.shade.sample_light import NORMAL, ONE
from rle_splat.volume.volume import Volume
from tests.lamps import sun
from tests.light_codes import codes_and_reference
from tests.ways import by

SURFACE, THICK, SLANT = 12.37, 2.0, 2.0  # z of a flat wall's surface; voxels of the plate; tangent of the sun's angle
NEAR, FAR = 16.3, 24.3  # x of the plate's edges, towards the sun and away from it
SIDE, PIXELS = 48, 4  # voxels of the wall, and pixels for each
SUN = sun((SLANT, 0.0, -1.0))
MATT = Shade(ambient=0.0, diffuse=1.0, specular=0.0, shininess=1.0)
HARD = TransferFunction(
    opacity=((0.45, 0.0), (0.55, 0.9)), color=((0.0, 1.0, 1.0, 1.0),), opacity_unit_distance=1.0, shade=MATT
)
QUALITIES = "draft", "standard", "fine", "strict"


def plate(low, high):
    """A box that lies across the wall, from x = NEAR to FAR, between two heights."""
    corners = np.array([(x, y, z) for x in (NEAR, FAR) for y in (9.2, 38.4) for z in (low, high)])
    sides = (0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)
    return np.array([corners[[a, b, c]] for side in sides for a, b, c in (side[:3], (side[0], *side[2:]))])


SEATED = plate(SURFACE, SURFACE + THICK)


def wall(triangles=None, lights=(SUN,), **more):
    z = np.mgrid[:26, :SIDE, :SIDE][0]
    field = np.clip((SURFACE - z) / 3.0 + 0.5, 0.0, 1.0).astype(np.float32)
    at = np.eye(4)
    at[:3, 3] = SIDE / 2 - 0.5, SIDE / 2 - 0.5, 100.0
    camera = Camera(at, type="ORTHO", ortho_scale=SIDE - 8.0, clip_end=1000.0)
    size = PIXELS * (SIDE - 8)
    usual = dict(lights=lights, headlight=False, volume_shadows=True, triangles=triangles)
    return Scene(Volume(field, np.eye(4)), HARD, camera, size, size, **usual, **more)


def beside_plate(quality, way="numba", lights=(SUN,), **more):
    """(n,) x of pixels in a row across the plate, and the light there, of that without the plate; none on the plate."""
    quality = Quality.preset(quality, classification="post")
    with by(way):
        shaded, lit = (render(wall(which, lights, **more), quality).rgba for which in (SEATED, None))
    row = shaded.shape[0] // 2 + 3
    x = (np.arange(shaded.shape[1]) + 0.5) / PIXELS + 3.5
    seen = shaded[row, :, 3] > 0.5 * lit[row, :, 3]
    return x[seen], share_of(shaded[row, seen], lit[row, seen])


def share_of(shaded, lit):
    """What light a color with its alpha has of that of another one."""
    return shaded[..., 0] / shaded[..., 3] / (lit[..., 0] / lit[..., 3])


@pytest.mark.parametrize("indirect", [0.0, 1.0])
@pytest.mark.parametrize(("quality", "way"), [(quality, "numba") for quality in QUALITIES] + [("standard", "numpy")])
def test_a_plate_on_a_wall_darkens_it_as_far_as_geometry_says(quality, way, indirect):
    x, light = beside_plate(quality, way, indirect_light=indirect)
    behind, end = x > FAR, FAR + SLANT * THICK
    assert x[behind].min() < FAR + 0.4 and x[~behind].max() > NEAR - 0.4, "the wall is seen beside the plate"
    assert light[behind & (x < FAR + 1.5)].max() < 0.1, "the shadow begins at the plate"
    shadow = np.interp(0.5, light[behind], x[behind])
    assert abs(shadow - end) < 1.0
    # Voxels below the surface, from which its light is interpolated, are shaded a little further.
    assert light[x > end + 2.5].min() > 0.85 and light[x > end + 4.5].min() > 0.98
    assert light[x < NEAR - 2.0].min() > 0.98
    assert light[(x < NEAR - 0.75)].min() > 0.85, "the side that faces the sun"


@pytest.mark.parametrize("quality", QUALITIES)
@pytest.mark.parametrize("depth", [0.0, 0.5, 1.0])
def test_a_mesh_in_the_surface_or_below_it_leaves_no_specks(quality, depth):
    """A sheet up to a voxel below the wall's surface: the wall around stays as it is, and wavers by 5 % before it."""
    heights = np.full(4, SURFACE - depth)
    corners = np.stack(((NEAR, FAR, FAR, NEAR), (9.2, 9.2, 38.4, 38.4), heights), axis=1)
    sheet = corners[[[0, 1, 2], [0, 2, 3]]]
    given = Quality.preset(quality, classification="post")
    shaded, lit = (render(wall(which), given).rgba for which in (sheet, None))
    x = (np.arange(shaded.shape[1]) + 0.5) / PIXELS + 3.5
    inside = np.ix_((x > 14.0) & (x < 34.0), (x > NEAR + 2.5) & (x < FAR - 2.5))
    around = np.ix_((x > 14.0) & (x < 34.0), (x < NEAR - 2.5) | (x > FAR + 5.0))
    assert np.abs(shaded[around][..., 0] / lit[around][..., 0] - 1.0).max() < 0.01
    if depth > 0.0:
        share = share_of(shaded[inside], lit[inside])
        assert shaded[inside][..., 3].min() > 0.1 and share.min() > 0.5 and share.std() < 0.05


@pytest.mark.parametrize("light", [SUN, replace(SUN, angle=0.3)], ids=["sun", "wide sun"])
@pytest.mark.parametrize("indirect", [0.0, 1.0])
def test_what_meshes_leave_is_that_of_the_reference(light, indirect, monkeypatch):
    """T and U of strict pictures; only rays within a pixel of an edge may differ."""
    scene = wall(SEATED, (light,), indirect_light=indirect)
    codes, reference, z = codes_and_reference(scene, 7, monkeypatch)
    expected = reference[:, NORMAL:]
    off = np.abs(codes[:, NORMAL:] / float(ONE) - expected)
    above = z >= SURFACE  # below, all is dark
    assert 0.03 < (expected[above] < 0.5).mean() < 0.5
    assert (off > 0.02).mean() < 0.06 and off.mean() < 0.01


def test_a_mesh_that_moves_makes_only_its_own_shadow_anew():
    cache, quality = StageCache(), Quality.preset("standard", classification="post")
    scene = wall(SEATED)
    first = render(scene, quality, cache=cache).rgba
    before = dict(cache.made)
    moved = render(replace(scene, triangles=SEATED + (1.0, 0.0, 0.0)), quality, cache=cache).rgba
    made = {stage for stage, count in cache.made.items() if count != before.get(stage, 0)}
    assert {"mesh shadows", "codes"} <= made and "shadows" not in made and "normals" not in made
    again = render(scene, quality, cache=cache).rgba
    assert np.abs(first - moved).max() > 0.1 and np.array_equal(first, again)
