"""View factorisation: slice map and homography together are the camera, for every camera and matrix."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline.plan_model import family_of
from rle_splat.pipeline.render import render
from rle_splat.scene import DEPTH_RULES, NO_DEPTH, Camera, Quality, RleSplatError, Scene
from rle_splat.splat.arguments import rays_of
from rle_splat.view import ray_intervals
from rle_splat.view.base_plane import base_plane
from rle_splat.view.depth_rules import cell_nodes, place_sheets
from rle_splat.view.eye import index_view
from rle_splat.view.footprints import FOOTPRINTS
from rle_splat.view.principal_axis import candidate_pyramids, dominant_axis
from rle_splat.view.projection import world_to_pixel
from rle_splat.view.turntable import turntable
from rle_splat.volume.axes import AXES
from rle_splat.volume.volume import Volume
from tests.ways import NUMPY


def random_rotation(rng):
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q


def random_scene(rng, kind):
    """A camera that looks roughly at a sheared, scaled, perhaps mirrored volume, and the volume's matrix."""
    shape = tuple(int(n) for n in rng.integers(3, 40, 3))
    size = 10.0 ** rng.uniform(-3, 3)
    matrix = np.eye(4)
    matrix[:3, :3] = random_rotation(rng) @ np.diag(rng.uniform(0.3, 3.0, 3) * rng.choice((-1, 1), 3)) * size
    matrix[:3, :3] @= np.eye(3) + 0.3 * rng.uniform(-1, 1, (3, 3))
    matrix[:3, 3] = rng.normal(size=3) * size
    center = matrix[:3, :3] @ (0.5 * np.array(shape)) + matrix[:3, 3]
    reach = np.abs(matrix[:3, :3]).sum() * max(shape)
    placed = np.eye(4)
    placed[:3, :3] = random_rotation(rng)
    if np.linalg.det(placed[:3, :3]) < 0:
        placed[:3, 0] *= -1
    placed[:3, 3] = center + placed[:3, 2] * reach * rng.uniform(1.0, 4.0)
    camera = Camera(
        matrix_world=placed, type=kind, lens=rng.uniform(15, 90), ortho_scale=reach * rng.uniform(0.5, 2),
        shift_x=rng.uniform(-0.3, 0.3), shift_y=rng.uniform(-0.3, 0.3), clip_start=1e-3 * reach, clip_end=1e3 * reach,
        pixel_aspect=(1.0, rng.uniform(0.5, 2)), sensor_fit=str(rng.choice(("AUTO", "HORIZONTAL", "VERTICAL"))),
    )  # fmt: skip
    return camera, matrix, shape


@pytest.mark.parametrize("kind", ["ORTHO", "PERSP"])
def test_slice_map_then_homography_is_the_projection(kind):
    rng = np.random.default_rng(1 if kind == "ORTHO" else 2)
    planes_seen = 0
    for _ in range(200):
        camera, matrix, shape = random_scene(rng, kind)
        width, height = (int(n) for n in rng.integers(20, 90, 2))
        view = index_view(camera, matrix, width, height)
        to_pixel = world_to_pixel(camera, width, height) @ matrix
        for axis, sign in candidate_pyramids(view):
            plane = base_plane(view, shape, axis, sign, "simpson", 1.3)
            if plane is None:
                continue
            planes_seen += 1
            i, j, k = AXES[axis]
            for sheet in (0, len(plane.sheets) // 2, -1):
                point = np.ones(4)
                point[[i, j]] = rng.uniform(0, 1, 2) * (shape[i], shape[j])
                point[k] = plane.sheets.position[sheet]
                u = plane.scale[sheet] * point[[i, j]] + plane.offset[sheet]
                on_plane = (u + plane.origin) / plane.density
                there = plane.homography @ (*on_plane, 1.0)
                direct = to_pixel @ point
                if direct[2] <= 0.0:
                    continue
                np.testing.assert_allclose(there[:2] / there[2], direct[:2] / direct[2], atol=1e-6, rtol=1e-7)
    assert planes_seen > 150


def test_every_visible_ray_finds_its_base_plane_inside_the_window():
    """The ray of any pixel that hits the volume's box lands in the window of its own pyramid's base plane."""
    rng = np.random.default_rng(5)
    rays = 0
    for _ in range(60):
        camera, matrix, shape = random_scene(rng, str(rng.choice(("ORTHO", "PERSP"))))
        view = index_view(camera, matrix, 40, 30)
        planes = {(a, s): base_plane(view, shape, a, s, "slice", 1.0) for a, s in candidate_pyramids(view)}
        point = rng.uniform(0, 1, 3) * (np.array(shape) - 1)
        pixel = view.projection @ np.append(point, 1.0)
        column, row = pixel[:2] / pixel[2]
        if pixel[2] <= 0 or not (0 <= column <= 40 and 0 <= row <= 30):
            continue
        axis, sign = dominant_axis(view.ray_directions(column, row))
        plane = planes[int(axis), int(sign)]
        assert plane is not None
        x, y, w = np.linalg.inv(plane.homography) @ (column, row, 1.0)
        u = np.array((x, y)) / w * plane.density - plane.origin
        assert (u >= 1).all() and u[0] < plane.width - 2 and u[1] < plane.height - 2
        rays += 1
    assert rays > 20


@pytest.mark.parametrize("boxed, reach", [(True, 2), (False, 17)])
def test_all_that_the_picture_reads_of_a_base_plane_is_seen_and_much_of_the_others_is_not(boxed, reach):
    """Whatever a visible ray through the volume's medium reads lies in its row's ``seen`` columns, in windows too."""
    rng = np.random.default_rng(6)
    rays, kept, held = 0, 0, 0
    for _ in range(30):
        camera, matrix, shape = random_scene(rng, str(rng.choice(("ORTHO", "PERSP"))))
        view = index_view(camera, matrix, 640, 480)
        planes = {}
        for pyramid in candidate_pyramids(view):
            rule = str(rng.choice(("slice", "simpson", "midpoint-1")))
            planes[pyramid] = base_plane(view, shape, *pyramid, rule, 2.0, FOOTPRINTS["tent"], boxed, reach)
            if planes[pyramid] is not None:
                kept += np.subtract(*planes[pyramid].seen[::-1]).clip(0).sum()
                held += planes[pyramid].width * planes[pyramid].height
        around = 0.0 if boxed else 0.99
        for point in rng.uniform(-around, np.array(shape) - 1 + around, (200, 3))[:80]:
            pixel = view.projection @ np.append(point, 1.0)
            column, row = pixel[:2] / pixel[2]
            if pixel[2] <= 0 or not (0 <= column <= 640 and 0 <= row <= 480):
                continue
            plane = planes[tuple(int(n) for n in dominant_axis(view.ray_directions(column, row)))]
            x, y, w = np.linalg.inv(plane.homography) @ (column, row, 1.0)
            left, top, right, bottom = (int(side) for side in (column, row, column + 1, row + 1))
            for one in (plane, plane.window((left, top, right, bottom), reach)):
                u, v = np.floor(np.array((x, y)) / w * one.density).astype(int) - one.origin
                rows = slice(max(v + 1 - reach, 0), v + reach + 1)
                assert (one.seen[0, rows] <= max(u + 1 - reach, 0)).all()
                assert (one.seen[1, rows] > min(u + reach, one.width - 1)).all()
            rays += 1
    assert rays > 400
    assert kept < 0.9 * held


def test_pixels_read_are_those_of_all_sheet_pixels(monkeypatch):
    """Found at the corners of nearly all planes, and the same as among all of their pixels but for a rounding."""
    rng, few, planes = np.random.default_rng(7), [], 0
    positions = ray_intervals.reference.picture_positions

    def count(*arguments):
        few.append(arguments[2].shape[1] == 2)
        return positions(*arguments)

    monkeypatch.setattr(ray_intervals.reference, "picture_positions", count)
    for _ in range(60):
        camera, matrix, shape = random_scene(rng, str(rng.choice(("ORTHO", "PERSP"))))
        view = index_view(camera, matrix, 400, 300)
        for pyramid in candidate_pyramids(view):
            plane = base_plane(view, shape, *pyramid, "slice", 1.0)
            if plane is not None:
                column, row = positions(399.0, 299.0, *ray_intervals._along_and_across(plane))
                whole = int(column.min()), int(row.min()), int(column.max()) + 2, int(row.max()) + 2
                assert np.abs(np.subtract(ray_intervals.pixels_read(plane), whole)).max() <= 1
                planes += 1
    assert planes == len(few) > 60 and np.mean(few) > 0.9


def test_path_length_is_the_world_length_between_slices():
    rng = np.random.default_rng(7)
    for kind in ("ORTHO", "PERSP"):
        camera, matrix, shape = random_scene(rng, kind)
        view = index_view(camera, matrix, 30, 30)
        for axis, sign in candidate_pyramids(view):
            plane = base_plane(view, shape, axis, sign, "slice", 1.0)
            if plane is None:
                continue
            lengths = rays_of(plane, 1.0, corrected=True).lengths()
            i, j, k = AXES[axis]
            u, v = plane.width // 2, plane.height // 3
            ends = []
            for sheet in (0, -1):
                point = np.ones(4)
                point[[i, j]] = ((u, v) - plane.offset[sheet]) / plane.scale[sheet]
                point[k] = plane.sheets.position[sheet]
                ends.append((matrix @ point)[:3])
            depth = abs(plane.sheets.position[-1] - plane.sheets.position[0])
            length = np.linalg.norm(ends[1] - ends[0])
            np.testing.assert_allclose(lengths[v, u], length / depth, rtol=1e-5)


@pytest.mark.parametrize("rule", [*DEPTH_RULES, "midpoint-3", "midpoint-64"])
@pytest.mark.parametrize("sign", [1, -1])
def test_sheets_fill_the_depth_without_gaps(rule, sign):
    sheets = place_sheets(7, sign, rule, None)
    assert (np.diff(sign * sheets.position) > 0).all(), "front to back"
    np.testing.assert_allclose(sheets.end[:-1], sheets.begin[1:], atol=1e-12)
    np.testing.assert_allclose(sheets.end - sheets.begin, sheets.thickness, atol=1e-12)
    # The tent medium of a constant grid holds exactly n voxels of it, ramps included.
    tent = np.clip(np.minimum(sheets.position + 1, 7 - sheets.position), 0, 1)
    np.testing.assert_allclose((sheets.thickness * tent).sum(), 7.0, rtol=1e-12)


@pytest.mark.parametrize("boxed", [False, True])
@pytest.mark.parametrize("n_slices", [1, 2, 3, 7, 8])
def test_every_second_slice_is_a_sheet_and_the_outermost_are(n_slices, boxed):
    for sign in (1, -1):
        sheets = place_sheets(n_slices, sign, "slice-2", None, boxed=boxed)
        found = (sheets.position if sign > 0 else n_slices - 1 - sheets.position).tolist()
        wanted = sorted({*range(0, n_slices, 2), n_slices - 1})
        if boxed and n_slices == 1:
            wanted = []  # no depth at all
        assert found == wanted
        assert (sheets.slice_weights.max(axis=1) == 1.0).all(), "of one slice each"
        # Trapezoids between them, and, where there is no box, the halves of the ramps of a voxel at both ends.
        gaps, past = np.diff(wanted), 0.0 if boxed else 0.5
        thickness = np.concatenate(([past], gaps / 2)) + np.concatenate((gaps / 2, [past])) if wanted else []
        np.testing.assert_allclose(sheets.thickness, thickness, atol=1e-12)


@pytest.mark.parametrize("sign, eye", [(1, 3.3), (1, 4.0), (-1, 4.7), (1, -0.4), (-1, 8.2), (1, 6.6)])
def test_every_second_slice_ahead_of_an_eye_inside(sign, eye):
    sheets = place_sheets(9, sign, "slice-2", eye, boxed=True)
    ahead = 8.0 - max(eye, 0.0) if sign > 0 else min(eye, 8.0)
    np.testing.assert_allclose(sheets.thickness.sum(), ahead, atol=1e-9)
    assert (sign * (sheets.position - eye) > 0.0).all() and (np.diff(sign * sheets.position) > 0.0).all()
    assert sheets.position[-1] == (8.0 if sign > 0 else 0.0) and sheets.end[-1] == (8.0 if sign > 0 else 0.0)
    whole = sheets.position[sheets.position == np.rint(sheets.position)]
    assert (np.abs(np.diff(whole))[:-1] == 2.0).all()


@pytest.mark.parametrize("m", range(1, 65))
def test_midpoints_halve_m_equal_parts_of_a_cell(m):
    assert Quality(depth_rule=f"midpoint-{m}").depth_rule == f"midpoint-{m}"
    position, weight = np.array(cell_nodes(f"midpoint-{m}")).T
    edges = np.linspace(0.0, 1.0, m + 1)
    np.testing.assert_allclose(position, (edges[:-1] + edges[1:]) / 2, atol=1e-12)
    np.testing.assert_allclose(weight, np.diff(edges), atol=1e-12)


@pytest.mark.parametrize("rule, count", [
    ("slice", 1), ("simpson", 2), ("gauss2", 2), ("midpoint-1", 1), ("midpoint-4", 4), ("preintegrated", 1),
    ("preintegrated-2", 2),
])  # fmt: skip
def test_the_model_of_plans_counts_sheets_per_voxel(rule, count):
    assert family_of(rule)[1] == count
    few, many = (len(place_sheets(n, 1, rule, None, boxed=True)) for n in (10, 30))
    assert many - few == 20 * count


@pytest.mark.parametrize(
    "rule", ["midpoint-0", "midpoint-65", "midpoint-x", "midpoint-", "midpoint--2", "midpoint-2.5", "midpoint-03"]
)
def test_a_depth_rule_that_is_none_is_refused_in_a_sentence(rule):
    with pytest.raises(RleSplatError, match=r"no depth rule called .*midpoint-M with a whole number M from 1 to 64; "):
        Quality(depth_rule=rule)


def test_the_cell_around_the_eye_is_integrated_from_the_eye_on():
    sheets = place_sheets(10, 1, "simpson", 3.3)
    assert sheets.position.min() > 3.3
    np.testing.assert_allclose(sheets.begin[0], 3.3)
    np.testing.assert_allclose(sheets.thickness.sum(), 10 - 3.3 - 1 / 6)  # the node at slice 10 holds nothing
    assert len(place_sheets(10, -1, "simpson", -1.5)) == 0, "nothing lies ahead"


@pytest.mark.parametrize("scale", [(1, 1, 0), (0, 0, 0), (1, 1e-14, 1)])
def test_a_flat_matrix_is_refused_in_a_sentence(scale):
    matrix = np.diag((*scale, 1.0))
    with pytest.raises(RleSplatError, match="flattens the volume"):
        index_view(Camera(), matrix, 8, 8)


def test_ties_go_to_the_earlier_axis():
    axis, sign = dominant_axis(np.array([[1.0, 1.0, 1.0], [0.0, -1.0, 1.0], [0.0, 0.0, -2.0]]))
    assert axis.tolist() == [0, 1, 2] and sign.tolist() == [1, -1, -1]


@pytest.mark.parametrize("away", [0.0, 1e-9, 1e-4, -1e-9])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("rule", ["slice", "preintegrated", "simpson"])
def test_no_sheet_lies_in_an_eye_on_the_face_of_the_box(rule, sign, away):
    face = 0.0 if sign > 0 else 4.0
    sheets = place_sheets(5, sign, rule, face - sign * away, boxed=True)
    assert (sign * (sheets.position - face)).min() > 0.1
    assert sheets.thickness.sum() == pytest.approx(4.0, abs=1e-6)
    assert sheets.begin[0] == pytest.approx(sign * face, abs=1e-6)


@NUMPY
@pytest.mark.parametrize("scale, told", ((1e6, False), (1e12, True)))
def test_depths_as_large_as_what_stands_for_none_are_told(scale, told, way):
    """Blender's 1e10 is a length, too: the picture is made, and a remark says that its depths cannot be told apart."""
    volume = Volume(np.full((8, 8, 8), 200, np.uint8), np.eye(4))
    camera, matrix = turntable(volume, 20, 10)
    grown = np.diag((scale, scale, scale, 1.0))
    carried = replace(
        camera, matrix_world=grown @ camera.matrix_world, ortho_scale=scale * camera.ortho_scale,
        clip_start=scale * camera.clip_start, clip_end=scale * camera.clip_end,
    )  # fmt: skip
    tf = TransferFunction(opacity=((0, 0.9),), color=((0, 1, 1, 1),))
    found = render(Scene(volume, tf, carried, 16, 16, grown @ matrix), Quality())
    assert found.rgba[8, 8, 3] > 0.9
    assert (found.depth[8, 8] >= NO_DEPTH) == told
    remarks = [remark for remark in found.report["remarks"] if "stand for none" in remark]
    assert len(remarks) == told and all(remark.endswith(".") for remark in remarks)
