"""Extract Surface: where the surface lies, that it is closed, its colors, and what cuts it."""

import json

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from tests.blender import scenes

MIDDLE, RADIUS = np.array((15.2, 13.9, 14.6)), 9.3  # of the ball, in voxels and in mm
SHAPE, SPACING = (32, 28, 15), np.array((1.0, 1.0, 2.0))
COLOR = (0.2, 0.5, 0.9)


def places(shape=SHAPE, spacing=SPACING):
    """(3, nz, ny, nx): where voxels are, in mm."""
    z, y, x = np.indices(shape[::-1])
    return np.array((x, y, z)) * spacing[:, None, None, None]


def write_ball(folder, slope=20.0, shape=SHAPE):
    """A ball whose values fall linearly with the distance from its middle, 300 at its surface."""
    distance = np.linalg.norm(places(shape) - MIDDLE[:, None, None, None], axis=0)
    return scenes.import_raw(folder, (300.0 + slope * (RADIUS - distance)).astype(np.float32), tuple(SPACING), "ball")


@pytest.fixture
def ball(tmp_path):
    owner = write_ball(tmp_path)
    # Half of the largest opacity, 0.4, is at 300, by a transfer function that is steep and not symmetric.
    scenes.load_color(tmp_path, COLOR, opacity=[[296.0, 0.0], [298.0, 0.1], [300.0, 0.4], [301.0, 0.8]])
    return owner


def extract(**options):
    assert bpy.ops.rle_splat.extract_surface(**options) == {"FINISHED"}
    return bpy.context.view_layer.objects.active


def points(surface, to=None):
    """(n, 3): the vertices in the world."""
    scenes.update()
    flat = np.empty(3 * len(surface.data.vertices), np.float32)
    surface.data.vertices.foreach_get("co", flat)
    matrix = np.array(surface.matrix_world if to is None else to)
    return flat.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


def corners(surface):
    """(m, 4): the vertices of the faces, all of which have four."""
    found = np.empty(len(surface.data.loops), np.int32)
    surface.data.loops.foreach_get("vertex_index", found)
    assert len(found) == 4 * len(surface.data.polygons)
    return found.reshape(-1, 4)


def check_closed(surface):
    """Every edge has two faces, which go along it in opposite directions."""
    faces = corners(surface)
    edges = np.concatenate([faces[:, [i, (i + 1) % 4]] for i in range(4)])
    assert np.unique(edges, axis=0, return_counts=True)[1].max() == 1
    _, counts = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    assert counts.min() == counts.max() == 2
    assert not surface.data.validate()  # it had nothing to correct


def content(surface):
    """The volume inside, above 0 where the faces look outwards."""
    corner = points(surface)[corners(surface)]
    triangles = np.concatenate((corner[:, [0, 1, 2]], corner[:, [0, 2, 3]]))
    return np.einsum("ij,ij->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6.0


def colors(surface):
    attribute = surface.data.color_attributes[0]
    assert (attribute.data_type, attribute.domain) == ("FLOAT_COLOR", "POINT")
    found = np.empty(4 * len(surface.data.vertices), np.float32)
    attribute.data.foreach_get("color", found)
    return found.reshape(-1, 4)


def test_a_ball_has_its_radius_and_is_closed(ball):
    surface = extract(opacity=0.5)
    radii = np.linalg.norm(points(surface) - MIDDLE, axis=1)
    print("radius error, mm:", radii.min() - RADIUS, radii.max() - RADIUS)
    assert RADIUS - 0.15 < radii.min() and radii.max() < RADIUS + 0.01  # one voxel has 1 x 1 x 2 mm
    check_closed(surface)
    assert content(surface) == pytest.approx(4.0 / 3.0 * np.pi * RADIUS**3, rel=0.03)
    np.testing.assert_allclose(colors(surface), np.tile((*COLOR, 1.0), (len(radii), 1)), atol=1e-4)
    by_value = extract(of="VALUE", value=300.0)
    np.testing.assert_allclose(points(by_value), points(surface), atol=1e-5)


def test_the_surface_belongs_to_its_volume(ball, bridge):
    ball.matrix_world = Matrix.Translation((1.0, 2.0, 3.0)) @ Matrix.Diagonal((2, 1, 1, 1))
    bpy.context.scene.rle_splat.scene_scale = 0.1
    scenes.update()
    surface = extract()
    assert surface.parent == ball
    back = np.array((ball.matrix_world @ Matrix.Scale(0.1, 4)).inverted())
    at = points(surface) @ back[:3, :3].T + back[:3, 3]
    assert np.abs(np.linalg.norm(at - MIDDLE, axis=1) - RADIUS).max() < 0.15
    before = points(surface)
    bpy.context.scene.rle_splat.scene_scale = 0.2  # about the volume's origin
    origin = np.array(ball.matrix_world.translation)
    np.testing.assert_allclose(points(surface) - origin, 2.0 * (before - origin), atol=1e-4)
    assert bridge("volumes.volumes").volume_object(bpy.context) == ball  # although the surface is active


def test_a_mirrored_volume_has_faces_that_look_outwards(tmp_path):
    """In the volume's own space; an affine that mirrors is that of many scans."""
    nifti = pytest.importorskip("nibabel")
    voxels = 300.0 + 20.0 * (RADIUS - np.linalg.norm(places() - MIDDLE[:, None, None, None], axis=0))
    path = tmp_path / "mirrored.nii"
    nifti.save(nifti.Nifti1Image(voxels.transpose(2, 1, 0).astype(np.float32), np.diag((-1.0, 1.0, 2.0, 1.0))), path)
    bpy.context.scene.rle_splat.scene_scale = 1.0
    bpy.ops.rle_splat.import_volume(filepath=str(path))
    surface = extract(of="VALUE", value=300.0)
    check_closed(surface)
    assert content(surface) == pytest.approx(4.0 / 3.0 * np.pi * RADIUS**3, rel=0.03)


def test_where_the_data_ends_the_surface_is_closed(tmp_path):
    """The ball's lower half is outside of the volume; the faces there lie in the plane of the voxel centers."""
    write_ball(tmp_path, shape=(32, 28, 8))
    surface = extract(of="VALUE", value=300.0)
    check_closed(surface)
    top = 14.0
    heights = points(surface)[:, 2]
    assert heights.max() == pytest.approx(top, abs=1e-4) and np.isclose(heights, top, atol=1e-4).sum() > 100


def test_clip_objects_cut_the_surface_and_it_stays_closed(ball):
    cut = 16.3
    bpy.ops.rle_splat.add_cutting_object(kind="PLANE")
    plane = bpy.context.view_layer.objects.active
    plane.matrix_world = Matrix.Translation((cut, 0.0, 0.0)) @ Matrix.Rotation(np.pi / 2, 4, "Y")
    scenes.activate(ball)
    scenes.update()
    surface = extract()
    check_closed(surface)
    at = points(surface)[:, 0]
    assert at.max() == pytest.approx(cut, abs=1e-3) and at.min() == pytest.approx(MIDDLE[0] - RADIUS, abs=0.15)
    high = cut - MIDDLE[0]
    kept = np.pi * (2.0 / 3.0 * RADIUS**3 + RADIUS**2 * high - high**3 / 3.0)
    assert content(surface) == pytest.approx(kept, rel=0.05)


@pytest.mark.parametrize("given", [{}, {"of": "VALUE", "value": 300.0}], ids=["opacity", "value"])
def test_hidden_labels_are_left_out(ball, tmp_path, given):
    labels = np.where(places()[0] <= 16.0, 1, 2).astype(np.uint8)
    path = tmp_path / "parts.raw"
    path.write_bytes(np.ascontiguousarray(labels).tobytes())
    ball.rle_splat.label_file = str(path)
    bpy.ops.rle_splat.load_segments()
    next(row for row in ball.rle_splat.labels if row.label == 2).show = False
    surface = extract(**given)
    check_closed(surface)
    at = points(surface)[:, 0]
    assert 16.0 <= at.max() <= 17.0 and at.min() == pytest.approx(MIDDLE[0] - RADIUS, abs=0.15)


def test_the_colors_are_those_below_the_surface(tmp_path):
    """Opaque at once, so each side of a cut shows the color of the values there."""
    owner = scenes.import_raw(tmp_path, (places() / SPACING[:, None, None, None])[0].astype(np.float32), name="ramp")
    color = [[0.0, 0.0, 0.0, 0.0], [31.0, 1.0, 0.5, 0.0]]
    ramp = {"name": "ramp", "unit": None, "opacity": [[0.0, 1.0]], "color": color}
    (tmp_path / "ramp.json").write_text(json.dumps(ramp))
    bpy.ops.rle_splat.load_transfer_function(filepath=str(tmp_path / "ramp.json"))
    surface = extract()
    check_closed(surface)
    assert content(surface) == pytest.approx(31 * 27 * 14, rel=0.01)
    found, at = colors(surface)[:, :2], points(surface)[:, 0]
    middle = (at > 5.0) & (at < 26.0)
    np.testing.assert_allclose(found[middle], np.outer(at[middle] / 31.0, (1.0, 0.5)), atol=0.02)
    assert owner.rle_splat.is_volume


def test_noise_has_a_closed_surface_too(tmp_path):
    scenes.import_raw(tmp_path, np.random.default_rng(4).integers(0, 256, (12, 13, 14), np.uint8))
    check_closed(extract(of="VALUE", value=127.5))


def test_what_has_no_surface_is_refused(ball, tmp_path, refused):
    refused(bpy.ops.rle_splat.extract_surface, "lower the opacity", of="VALUE", value=1e6)
    scenes.load_color(tmp_path, COLOR, alpha=0.0)
    refused(bpy.ops.rle_splat.extract_surface, "is transparent")
