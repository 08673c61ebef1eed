"""A viewport's matrices as a camera, and its depth as the ends of rays: against Blender's own cameras and triangles."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from tests.blender.scenes import add_camera

SIZE = 640, 360
POINTS = np.random.default_rng(3).uniform((-2, -2, -2), (2, 2, 2), (50, 3))


@pytest.fixture
def view(bridge):
    return bridge("live.view")


@pytest.fixture
def to_pixel(core):
    projection = core("view.projection")

    def pixels(camera, size, points=POINTS):
        """(n, 3): column, row and depth of world points."""
        rows = projection.world_to_pixel(camera, *size)
        placed = np.column_stack((points, np.ones(len(points))))
        homogeneous = placed @ rows.T
        return np.column_stack((homogeneous[:, :2] / homogeneous[:, 2:], placed @ projection.depth_row(camera)))

    return pixels


def rows_of(matrix):
    return tuple(value for row in matrix for value in row)


def matrices_of(view, camera, size=SIZE, **more):
    """The matrices of a viewport that looks through a camera whose frame fills it."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    render = bpy.context.scene.render
    window = camera.calc_matrix_camera(
        depsgraph, x=size[0], y=size[1], scale_x=render.pixel_aspect_x, scale_y=render.pixel_aspect_y
    )
    return view.Matrices(rows_of(camera.matrix_world.normalized().inverted()), rows_of(window), *size, **more)


CAMERAS = [
    {"lens": 35.0}, {"lens": 80.0, "shift_x": 0.2, "shift_y": -0.1}, {"lens": 20.0, "sensor_fit": "VERTICAL"},
    {"type": "ORTHO", "ortho_scale": 5.0, "shift_x": -0.1, "shift_y": 0.3, "clip_start": 1.0},
]  # fmt: skip


@pytest.mark.parametrize("settings", CAMERAS)
@pytest.mark.parametrize("aspect", [(1.0, 1.0), (1.0, 1.5)])
def test_a_view_through_a_camera_is_that_camera(settings, aspect, bridge, view, to_pixel):
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = *SIZE, 100
    render.pixel_aspect_x, render.pixel_aspect_y = aspect
    camera = add_camera((3.0, -7.0, 4.0), (1.1, 0.1, 0.4), **settings)
    bpy.context.view_layer.update()
    plain, width, height = bridge("scene.camera").read_camera(bpy.context.evaluated_depsgraph_get())
    clip = camera.data.clip_start, camera.data.clip_end
    found = view.view_of(matrices_of(view, camera, clip=clip))
    assert (found.width, found.height) == (width, height) == SIZE
    np.testing.assert_allclose(to_pixel(found.camera, SIZE), to_pixel(plain, SIZE), atol=2e-3, rtol=1e-6)
    assert found.camera.clip_start == pytest.approx(plain.clip_start, rel=1e-5)
    assert found.camera.clip_end == pytest.approx(plain.clip_end, rel=1e-5)


def test_the_clip_distances_of_a_window_matrix(view):
    camera = add_camera((0.0, 0.0, 5.0), clip_start=0.2, clip_end=50.0)
    bpy.context.view_layer.update()
    found = view.view_of(matrices_of(view, camera)).camera
    assert (found.clip_start, found.clip_end) == (pytest.approx(0.2, rel=1e-4), pytest.approx(50.0, rel=1e-3))


def orthographic(view, reach=500.0, across=4.0, size=SIZE):
    """The matrices of a viewport's own orthographic view, which begins as far behind its origin as it ends before."""
    placed = Matrix.Translation((0.0, 0.0, 1.0)) @ Euler((1.0, 0.0, 0.5)).to_matrix().to_4x4()
    up = across * size[1] / size[0]
    window = np.diag((2.0 / across, 2.0 / up, -1.0 / reach, 1.0))
    window[0, 3], window[1, 3] = 0.1, -0.2
    return view.Matrices(rows_of(placed.inverted()), rows_of(window), *size)


def test_an_orthographic_view_sees_what_is_behind_its_origin(view, to_pixel):
    matrices = orthographic(view)
    nearest = -3.0
    found = view.view_of(matrices, nearest)
    assert found.set_back > 3.0
    pixels = to_pixel(found.camera, SIZE)
    clip = np.column_stack((POINTS, np.ones(len(POINTS)))) @ np.array(matrices.view).reshape(4, 4).T
    depth = -clip[:, 2]
    clip = clip @ np.array(matrices.window).reshape(4, 4).T
    assert (depth < 0.0).any(), "nothing lies behind the origin"
    np.testing.assert_allclose(pixels[:, 0], 0.5 * SIZE[0] * (1.0 + clip[:, 0]), atol=1e-3)
    np.testing.assert_allclose(pixels[:, 1], 0.5 * SIZE[1] * (1.0 - clip[:, 1]), atol=1e-3)
    np.testing.assert_allclose(pixels[:, 2], depth + found.set_back, atol=1e-4)
    assert found.camera.clip_start < nearest + found.set_back


def test_a_coarser_picture_is_of_the_same_view(view, to_pixel):
    camera = add_camera((3.0, -7.0, 4.0), (1.1, 0.1, 0.4), shift_x=0.1)
    bpy.context.view_layer.update()
    matrices = matrices_of(view, camera)
    half = view.resized(view.view_of(matrices), 320, 180)
    whole = to_pixel(view.view_of(matrices).camera, SIZE)
    np.testing.assert_allclose(to_pixel(half.camera, (320, 180))[:, :2], whole[:, :2] / 2.0, atol=1e-6)


@pytest.mark.parametrize("change", ["zero", "nan", "flat window", "no pixels"])
def test_degenerate_matrices_are_refused_in_one_sentence(change, view, core):
    camera = add_camera((0.0, 0.0, 5.0))
    bpy.context.view_layer.update()
    good = matrices_of(view, camera)
    bad = {
        "zero": view.Matrices((0.0,) * 15 + (1.0,), good.window, *SIZE),
        "nan": view.Matrices((float("nan"), *good.view[1:]), good.window, *SIZE),
        "flat window": view.Matrices(good.view, (0.0, *good.window[1:]), *SIZE),
        "no pixels": view.Matrices(good.view, good.window, 0, 360),
    }[change]
    with pytest.raises(core("scene").RleSplatError, match=r"^The view"):
        view.view_of(bad)


def depth_buffer(matrices, triangle, size):
    """(H, W) float32, the lowest row first: what OpenGL's depth buffer holds of a plane through three points."""
    view, window = (np.array(rows, np.float64).reshape(4, 4) for rows in (matrices.view, matrices.window))
    clip = np.column_stack((triangle, np.ones(3))) @ (window @ view).T
    ndc = clip[:, :3] / clip[:, 3:]  # depth is affine in the pixel, as a graphics card interpolates it
    plane = np.linalg.solve(np.column_stack((ndc[:, :2], np.ones(3))), ndc[:, 2])
    columns = 2.0 * (np.arange(size[0]) + 0.5) / size[0] - 1.0
    rows = 2.0 * (np.arange(size[1]) + 0.5) / size[1] - 1.0
    depth = plane[0] * columns + plane[1] * rows[:, None] + plane[2]
    return np.clip(0.5 * depth + 0.5, 0.0, 1.0).astype(np.float32)


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO", "viewport"])
def test_depths_of_a_buffer_are_those_of_the_triangles_it_shows(kind, view, core):
    size = 64, 40
    if kind == "viewport":
        matrices = orthographic(view, reach=50.0, size=size)
    else:
        camera = add_camera((3.0, -7.0, 4.0), (1.1, 0.1, 0.4), type=kind, ortho_scale=6.0, clip_end=100.0)
        bpy.context.view_layer.update()
        matrices = matrices_of(view, camera, size=size, clip=(camera.data.clip_start, camera.data.clip_end))
    found = view.view_of(matrices, -3.0)
    ahead = np.array([(-30.0, -30.0, -7.0, 1.0), (30.0, -30.0, -9.0, 1.0), (0.0, 40.0, -6.0, 1.0)])
    ahead[:, 2] += 8.0 if kind == "viewport" else 0.0  # about the origin of the view
    triangle = (ahead @ np.linalg.inv(np.array(matrices.view).reshape(4, 4)).T)[:, :3]
    buffer = depth_buffer(matrices, triangle, size)
    part = 5, 3, 60, 37
    ends = view.ray_ends(found, buffer[size[1] - part[3] : size[1] - part[1], part[0] : part[2]], part)
    with core("runtime.jit").use_reference():
        samples = core("effects.mesh_depth").mesh_depth(triangle[None], found.camera, *size)
    expected = samples.mean(axis=-1)
    inside = np.zeros(expected.shape, bool)
    inside[part[1] : part[3], part[0] : part[2]] = True
    assert np.isfinite(expected).all() and np.isinf(ends[~inside]).all()
    np.testing.assert_allclose(ends[inside], expected[inside], rtol=2e-3)


def test_nothing_drawn_ends_no_ray(view):
    camera = add_camera((0.0, 0.0, 5.0))
    bpy.context.view_layer.update()
    found = view.view_of(matrices_of(view, camera, size=(8, 6)))
    assert np.isinf(view.ray_ends(found, np.ones((6, 8), np.float32), (0, 0, 8, 6))).all()


def test_a_body_is_found_in_the_picture(view):
    camera = add_camera((0.0, 0.0, 10.0))
    bpy.context.view_layer.update()
    found = view.view_of(matrices_of(view, camera))
    body = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    left, top, right, bottom = view.pixels_of(found, body)
    assert abs(0.5 * (left + right) - SIZE[0] / 2) <= 1 and abs(0.5 * (top + bottom) - SIZE[1] / 2) <= 1
    assert 100 < right - left < 300
    assert view.pixels_of(found, body + (0.0, 0.0, 40.0)) is None, "behind the eye"
    assert view.pixels_of(found, body + (60.0, 0.0, 0.0)) is None, "beside the picture"
    assert view.pixels_of(found, body + (0.0, 0.0, 10.0)) == (0, 0, *SIZE), "the eye is inside"


def test_a_thin_line_ends_no_ray_of_a_draft(view):
    depths = np.full((7, 9), 5.0, np.float32)
    for rows in (slice(3, 4), slice(2, 5)):  # the latter covers whole blocks
        depths[rows] = 1.0
        assert (view.furthest_of_blocks(depths, 2) == 5.0).all()
    depths[1:5] = 1.0
    assert (view.furthest_of_blocks(depths, 2) == 1.0).any(), "a mesh ends rays"
    assert view.furthest_of_blocks(depths, 2).shape == (4, 5)
    slanted = np.where(np.arange(7)[:, None] == np.arange(9) // 2, np.float32(1.0), np.float32(5.0))
    assert (view.furthest_of_blocks(slanted, 1) == 5.0).all()
    tall = np.random.default_rng(0).random((2 * view.BAND + 7, 9), np.float32)  # more than a band
    for side in (1, 2):
        around = [
            [tall[max(y - 1, 0) : y + side + 1, max(x - 1, 0) : x + side + 1].max() for x in range(0, 9, side)]
            for y in range(0, len(tall), side)
        ]
        np.testing.assert_array_equal(view.furthest_of_blocks(tall, side), around)
    depths[2:6] = 1.0
    assert view.differ(depths, np.full_like(depths, 5.0), 0.002)
    assert not view.differ(depths, depths * np.float32(1.0001), 0.002)


def test_an_end_where_there_was_none_is_a_difference(view):
    none, some = np.full((10, 10), np.inf, np.float32), np.full((10, 10), np.inf, np.float32)
    assert not view.differ(none, some, 0.002)
    some[4] = 3.0
    assert view.differ(none, some, 0.002) and view.differ(some, none, 0.002)
    assert not view.differ(none, some, 0.2)


@pytest.mark.parametrize("settings", [{"lens": 35.0}, {"type": "ORTHO", "ortho_scale": 6.0}])
def test_lines_of_the_floor_end_no_ray_but_meshes_do(settings, bridge, core, view, to_pixel, monkeypatch):
    """Lines and a square in the plane z = 0, and a thin needle that passes through it, drawn point by point."""
    camera = add_camera((3.0, -5.0, 4.0), (0.95, 0.1, 0.5), **settings)
    bpy.context.view_layer.update()
    found = view.view_of(matrices_of(view, camera))
    ends, kind = np.full(SIZE[::-1], np.inf, np.float32), np.zeros(SIZE[::-1], np.int8)

    def draw(points, number):
        column, row, depth = to_pixel(found.camera, SIZE, points).T
        inside = (column >= 0) & (row >= 0) & (column < SIZE[0]) & (row < SIZE[1])
        at = row[inside].astype(int), column[inside].astype(int)
        ends[at], kind[at] = depth[inside], number

    along = np.linspace(-3.0, 3.0, 6000)
    for offset in np.linspace(-3.0, 3.0, 25):
        for points in ((along, offset + 0.0 * along), (offset + 0.0 * along, along)):
            draw(np.column_stack((*points, 0.0 * along)), 1)
    x, y = np.meshgrid(np.linspace(0.2, 0.9, 900), np.linspace(0.3, 1.1, 900))
    draw(np.column_stack((x.ravel(), y.ravel(), 0.0 * x.ravel())), 2)
    draw(np.column_stack((0.3 * along - 1.0, 0.1 * along, 0.4 * along)), 3)
    assert min((kind == number).sum() for number in (1, 2, 3)) > 100
    floor, drawn, drain = bridge("live.floor"), ends.copy(), core("runtime.steps").drain
    cleared = drain(floor.without_floor_steps(found, ends, (0, 0, *SIZE)))
    np.testing.assert_array_equal(ends, drawn)
    monkeypatch.setattr(floor, "BAND", 7)
    np.testing.assert_array_equal(drain(floor.without_floor_steps(found, ends, (0, 0, *SIZE))), cleared)
    beside = np.zeros_like(kind, bool)  # of a square or a needle, whose depth a line beside them takes
    for down in range(-2, 3):
        for right in range(-2, 3):
            beside |= np.roll(kind, (down, right), (0, 1)) > 1
    assert np.isinf(cleared[(kind == 1) & ~beside]).mean() > 0.98
    # Depths of points drawn last in a pixel are off by up to a pixel's change, and of the rim a pixel may stand out.
    assert np.isclose(cleared, ends, rtol=0.01)[kind == 2].mean() > 0.97
    above = (kind == 3) & (np.abs(ends - cleared) > 0.0)
    assert above.sum() < 0.1 * (kind == 3).sum(), "a needle is lost but where it passes through the floor"
    np.testing.assert_array_equal(cleared[kind == 0], ends[kind == 0])


def test_clip_distances_are_those_of_the_camera_that_a_view_looks_through(bridge):
    cameras = []
    for start in (0.25, 2.0):
        data = bpy.data.cameras.new("eye")
        data.clip_start, data.clip_end = start, 64.0
        cameras.append(bpy.data.objects.new("eye", data))
    context = SimpleNamespace(scene=SimpleNamespace(camera=cameras[0]))
    found = []
    for kind, is_own in (("PERSP", True), ("CAMERA", False), ("CAMERA", True)):
        space = SimpleNamespace(use_local_camera=is_own, camera=cameras[1], clip_start=0.5, clip_end=8.0)
        found.append(bridge("live.surface").clip_of(context, space, SimpleNamespace(view_perspective=kind)))
    assert found == [(0.5, 8.0), (0.25, 64.0), (2.0, 64.0)]
