"""Proves that a crop is the whole frame's pixels to the bit, whatever is in the scene, and that it does less work."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.effects.mesh_depth import mesh_depth
from rle_splat.pipeline.render import render
from rle_splat.scene import FOOTPRINTS, MODELS, WARP_FILTERS, Camera, Quality, RleSplatError, Scene
from rle_splat.splat.pixel_block import BLOCK
from rle_splat.splat.scratch import BAND
from rle_splat.view.base_plane import ALIGNED, base_plane
from rle_splat.view.eye import index_view
from rle_splat.view.principal_axis import candidate_pyramids
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from rle_splat.warp.warp import warp_reach

WIDTH, HEIGHT = 90, 74
KINDS = ("ortho", "perspective", "inside")
CROPS = [
    (31, 22, 47, 50),  # in the middle
    (0, 0, 13, 9),  # a corner
    (77, 60, WIDTH, HEIGHT),  # the corner across
    (40, 33, 41, 34),  # a pixel
    (0, 41, WIDTH, 42),  # a row
]
FUNCTION = TransferFunction(
    name="crop", opacity=((0.0, 0.0), (0.05, 0.0), (1.0, 0.7)), color=((0.0, 0.9, 0.3, 0.1), (1.0, 0.1, 0.4, 1.0)),
    opacity_unit_distance=1.0,
)  # fmt: skip
VOLUME = Volume(FIELDS["smooth"](18)[:, :16, :13].astype(np.float32), np.diag((1.0, 1.1, 0.9, 1.0)))
# A slanted triangle through the volume, and a strip before it: silhouettes against the volume and against each other.
TRIANGLES = np.array((
    ((-3.0, 4.0, -2.0), (15.0, 9.0, 4.0), (4.0, 12.0, 17.0)),
    ((6.2, -4.0, -20.0), (7.9, -4.0, -20.0), (7.4, -4.0, 40.0)),
))  # fmt: skip


def scene_of(kind, **more):
    """The volume, shaded, seen from outside, or by an eye in it that looks along six pyramids."""
    if kind == "inside":
        matrix = np.eye(4)
        matrix[:3, :3] = np.linalg.qr(np.array(((1.0, 0.4, -0.3), (0.2, 1.0, 0.5), (0.1, -0.6, 1.0))))[0]
        matrix[:3, 3] = 6.3, 7.1, 8.4
        camera, placed = Camera(matrix, lens=4.0, clip_start=1e-3), np.eye(4)
    else:
        camera, placed = turntable(VOLUME, 37.0, 24.0, 0.9, kind == "perspective", 50.0)
    return Scene(VOLUME, FUNCTION, camera, WIDTH, HEIGHT, volume_matrix=placed, **more)


def bits(array):
    return np.ascontiguousarray(array, np.float32).view(np.uint32)


def assert_crops_agree(scene, quality, crops=CROPS):
    """Every crop against the whole frame, to the bit."""
    whole = render(scene, quality)
    assert whole.rgba[..., 3].max() > 0.3
    for crop in crops:
        left, top, right, bottom = crop
        part = render(replace(scene, crop=crop), quality)
        assert part.depth.shape == (bottom - top, right - left)
        np.testing.assert_array_equal(bits(part.rgba), bits(whole.rgba[top:bottom, left:right]))
        np.testing.assert_array_equal(bits(part.depth), bits(whole.depth[top:bottom, left:right]))
    assert np.isfinite(whole.rgba).all()
    return whole


def some_of(things, way):
    """All of them, or the first for numpy, which takes its time."""
    return things[: 1 if way == "numpy" else None]


@pytest.mark.parametrize(
    ("kind", "warp_filter", "classification", "way"),
    (*((kind, name, ("pre", "post")[(k + n) % 2], "numba")
       for k, kind in enumerate(KINDS) for n, name in enumerate(WARP_FILTERS)),
     *zip(KINDS, WARP_FILTERS, ("pre", "post", "post"), ["numpy"] * len(KINDS))),
    indirect=["way"],
)  # fmt: skip
def test_a_crop_is_the_whole_frame_to_the_bit(kind, warp_filter, classification, way):
    quality = Quality(classification=classification, warp_filter=warp_filter)
    whole = assert_crops_agree(scene_of(kind), quality, some_of(CROPS, way))
    assert len(whole.report["plan"]["base_planes"]) > (2 if kind == "inside" else 0)


@pytest.mark.parametrize(
    ("kernel", "model", "way"),
    (*((kernel, model, "numba") for kernel in FOOTPRINTS for model in MODELS),
     *((kernel, MODELS[n % 2], "numpy") for n, kernel in enumerate(FOOTPRINTS))),
    indirect=["way"],
)  # fmt: skip
def test_under_every_model_and_footprint(kernel, model, way):
    for minification, density in some_of((("widen", 0.6), ("off", 1.7)), way):
        quality = Quality(
            classification="pre", kernel=kernel, model=model, minification=minification, sheet_density=density
        )
        assert_crops_agree(scene_of("perspective"), quality, CROPS[:1])


@pytest.mark.parametrize(
    ("kind", "way"), (*((kind, "numba") for kind in KINDS), ("perspective", "numpy")), indirect=["way"]
)
def test_with_meshes_and_silhouettes(kind, way):
    scene = scene_of(kind, triangles=TRIANGLES)
    alone = render(replace(scene, triangles=None), Quality())
    whole = assert_crops_agree(scene, Quality(), some_of(CROPS, way))
    assert np.abs(whole.rgba - alone.rgba).max() > 0.05


@pytest.mark.parametrize("kernel, way", [("tent", "numba"), ("gaussian", "numpy")], indirect=["way"])
def test_a_mesh_that_only_the_whole_frame_finds_in_the_volume(kernel, way):
    """The crop's own rays meet no mesh before the volume's end, so it leaves the meshes out: to no bit's cost."""
    corner = np.array((((-9.0, 8.0, 14.0), (4.0, 8.0, 14.0), (-9.0, 8.0, 30.0)),))
    far = np.array((((-200.0, 90.0, -200.0), (200.0, 90.0, -200.0), (0.0, 90.0, 400.0)),))
    scene = scene_of("ortho", triangles=np.concatenate((corner, far)))
    quality = Quality(classification="pre", kernel=kernel)
    whole = assert_crops_agree(scene, quality)
    parts = [render(replace(scene, crop=crop), quality) for crop in CROPS]
    on = [e["on"] for r in (whole, *parts) for e in r.report["effects"] if e["name"] == "mesh occlusion"]
    assert on[0] and not all(on)


@pytest.mark.parametrize(
    ("kind", "clips", "way"),
    (("ortho", (8.0, 21.0), "numba"), ("perspective", (8.0, 21.0), "numpy"), ("perspective", (1e-3, 16.0), "numba"),
     ("ortho", (14.0, 900.0), "numpy"), ("perspective", (14.0, 900.0), "numba")),
    indirect=["way"],
)  # fmt: skip
def test_with_clip_planes(kind, clips, way):
    scene = scene_of(kind)
    middle = np.linalg.inv(scene.camera.matrix_world) @ (*0.5 * (np.array(VOLUME.shape_xyz) - 1) * VOLUME.spacing, 1.0)
    from_camera = -middle[2] - 14.0
    camera = replace(scene.camera, clip_start=max(clips[0] + from_camera, 1e-3), clip_end=clips[1] + from_camera)
    clipped = assert_crops_agree(replace(scene, camera=camera), Quality(), some_of(CROPS, way))
    assert np.abs(clipped.rgba - render(scene, Quality()).rgba).max() > 0.02


def test_at_any_density_and_number_of_threads():
    for quality in (Quality.preset("draft"), Quality.preset("strict", threads=1), Quality.paper(), Quality(threads=2)):
        assert_crops_agree(scene_of("perspective"), quality, CROPS[:2])


def test_random_crops_from_random_sides():
    rng = np.random.default_rng(5)
    for _ in range(8):
        camera, placed = turntable(
            VOLUME, *rng.uniform(-180, 180, 2), rng.uniform(0.3, 1.4), bool(rng.integers(2)), 60.0
        )
        scene = Scene(VOLUME, FUNCTION, camera, WIDTH, HEIGHT, volume_matrix=placed, triangles=TRIANGLES)
        left, top = rng.integers(0, (WIDTH, HEIGHT))
        crop = (left, top, rng.integers(left + 1, WIDTH + 1), rng.integers(top + 1, HEIGHT + 1))
        assert_crops_agree(scene, Quality(sheet_density=rng.uniform(0.5, 2.0)), [crop])


def test_a_crop_beside_the_volume_is_empty_and_no_mistake():
    scene = replace(scene_of("ortho"), camera=turntable(VOLUME, fit=4.0)[0])
    part = render(replace(scene, crop=(0, 0, 8, 8)), Quality())
    assert not part.rgba.any() and (part.depth == np.float32(1e10)).all()
    assert part.report["plan"]["base_planes"] == []


def sheet_pixels(rendering):
    return sum(plane["width"] * plane["height"] for plane in rendering.report["plan"]["base_planes"])


def test_a_crop_makes_less_sheet(monkeypatch):
    """A crop of a hundredth of the picture splats the part of the sheets that it reads, and warps that."""
    made = []
    rasterize = mesh_depth
    monkeypatch.setattr(
        import_module("rle_splat.effects.mesh_occlusion"),
        "mesh_depth",
        lambda *a, **k: made.append(rasterize(*a, **k)) or made[-1],
    )
    scene = replace(scene_of("perspective"), width=900, height=740, triangles=TRIANGLES)
    quality = Quality.preset("draft")
    whole, part = render(scene, quality), render(replace(scene, crop=(400, 300, 490, 374)), quality)
    assert sheet_pixels(part) < 0.05 * sheet_pixels(whole)
    assert made[1].size < 0.1 * made[0].size
    np.testing.assert_array_equal(bits(part.rgba), bits(whole.rgba[300:374, 400:490]))
    cubic = replace(quality, warp_filter="cubic")
    assert sheet_pixels(render(replace(scene, crop=(400, 300, 490, 374)), cubic)) < 0.1 * sheet_pixels(whole)


def test_a_crop_inside_the_volume_leaves_out_pyramids_it_does_not_see():
    scene = scene_of("inside")
    whole, part = render(scene), render(replace(scene, crop=CROPS[0]))
    assert 0 < len(part.report["plan"]["base_planes"]) < len(whole.report["plan"]["base_planes"])


def test_the_report_names_crop_and_frame():
    report = render(replace(scene_of("ortho"), crop=(3, 4, 13, 24))).report
    assert report["image"] == {
        "width": 10, "height": 20, "full_width": WIDTH, "full_height": HEIGHT, "crop": [3, 4, 13, 24]
    }  # fmt: skip


def test_windows_move_offsets_by_whole_pixels_exactly():
    """(u - offset) of a pixel is the same number, to the bit, counted in a window and counted in the whole plane."""
    assert ALIGNED % BLOCK == 0 and ALIGNED % BAND == 0
    seen = 0
    for kind in ("ortho", "perspective", "inside"):
        scene = scene_of(kind)
        view = index_view(scene.camera, scene.index_to_world, 10 * WIDTH, 10 * HEIGHT)
        for axis, sign in candidate_pyramids(view):
            plane = base_plane(view, VOLUME.shape_xyz, axis, sign, "simpson", 1.3)
            window = None if plane is None else plane.window((410, 310, 500, 400), warp_reach(Quality()))
            if window is None:
                continue
            moved = np.array(window.origin) - plane.origin
            assert (moved % ALIGNED == 0).all() and moved.any()
            for pixel in range(0, 64, 7):
                np.testing.assert_array_equal(pixel - window.offset, (pixel + moved) - plane.offset)
            seen += 1
    assert seen >= 3


@pytest.mark.parametrize(
    "crop",
    [
        (0, 0, 0, 5),
        (5, 0, 4, 9),
        (-1, 0, 5, 5),
        (0, 0, WIDTH + 1, 5),
        (0, 0, 5, HEIGHT + 1),
        (0, 0, 5),
        "crop",
        7,
        (0.0, 0.0, 5.0, 5.0),
    ],
)
def test_a_crop_that_is_none_is_refused_in_a_sentence(crop):
    with pytest.raises(RleSplatError, match=r"whole numbers .*0 <= left < right <= 90 and 0 <= top < bottom <= 74"):
        scene_of("ortho", crop=crop)
