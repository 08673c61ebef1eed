"""Proves that edges of labels are smooth: outline and depth of a voxelized sphere and plane against the exact ones."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from rle_splat.classify import mixture
from rle_splat.classify.label_edges import edge_shares
from rle_splat.classify.mixture import Mixture
from rle_splat.classify.relevant import count_kept, gather_kept
from rle_splat.classify.transfer_function import GradientOpacity, TransferFunction
from rle_splat.runtime.steps import drain
from rle_splat.scene import Labels
from rle_splat.volume.blocks import block_steps
from rle_splat.volume.volume import Volume
from tests.ways import both

N = 32
PIXELS = 160
CENTER, RADIUS = np.array((15.3, 15.9, 14.6)), 9.37
NORMAL = np.array((0.32, -1.0, 0.23)) / np.linalg.norm((0.32, -1.0, 0.23))
SUBVOXELS = 4
VIEWS = ((0.0, 0.0), (35.0, 25.0), (80.0, -40.0))


def evenly(alpha, color=(1.0, 1.0, 1.0)):
    return TransferFunction(opacity=((0.0, alpha),), color=((0.0, *color),), opacity_unit_distance=1.0, shade=None)


CLEAR, OPAQUE = evenly(0.0), evenly(1.0)


def in_sphere(x, y, z):
    return (x - CENTER[0]) ** 2 + (y - CENTER[1]) ** 2 + (z - CENTER[2]) ** 2 < RADIUS**2


def below_plane(x, y, z):
    return NORMAL[0] * (x - CENTER[0]) + NORMAL[1] * (y - CENTER[1]) + NORMAL[2] * (z - CENTER[2]) < 1.3


def majority(inside) -> Volume:
    """A label map: 1 where more than half of a voxel's sub-voxels are inside."""
    fine = (np.arange(N * SUBVOXELS) + 0.5) / SUBVOXELS - 0.5
    z, y, x = np.meshgrid(fine, fine, fine, indexing="ij", sparse=True)
    blocks = inside(x, y, z).reshape(N, SUBVOXELS, N, SUBVOXELS, N, SUBVOXELS)
    return Volume((blocks.mean(axis=(1, 3, 5)) > 0.5).astype(np.uint8), np.eye(4))


def seen(stage, label_map, angles, tf, functions, smooth, **knobs):
    """The picture of a label map, and for each pixel where its ray starts and where its depth ends."""
    scene = stage.on_turntable(np.zeros((N, N, N)), *angles, size=(PIXELS, PIXELS), fit=1.0)
    volume = Volume(np.full((N, N, N), 100, np.uint8), np.eye(4))
    labels = Labels(label_map, functions, smooth=smooth)
    picture = stage.render(replace(scene, volume=volume, transfer_function=tf, labels=labels), **knobs)
    matrix, side = scene.camera.matrix_world, scene.camera.ortho_scale
    across = ((np.arange(PIXELS) + 0.5) / PIXELS - 0.5) * side
    starts = matrix[:3, 3] + across[None, :, None] * matrix[:3, 0] - across[:, None, None] * matrix[:3, 1]
    return picture, starts, starts - picture.depth[..., None] * matrix[:3, 2], -matrix[:3, 2]


def rms(distances):
    return float(np.sqrt(np.mean(np.square(distances))))


def sphere_errors(stage, tf, functions, smooth, **knobs):
    """RMS distance of the silhouette and of the depth from the sphere, and the silhouette's spread, in voxels.

    The silhouette's radius is that of a disk with the picture's opaque area, for each of 60 sectors.
    """
    label_map, edges, depths = majority(in_sphere), [], []
    for angles in VIEWS:
        picture, starts, ends, ahead = seen(stage, label_map, angles, tf, functions, smooth, **knobs)
        beside = starts - CENTER
        beside = beside - (beside @ ahead)[..., None] * ahead
        axes = np.linalg.svd(np.eye(3) - np.outer(ahead, ahead))[0][:, :2]
        sector = np.floor((np.arctan2(beside @ axes[:, 1], beside @ axes[:, 0]) / (2 * np.pi) + 0.5) * 60).astype(int)
        sector = np.minimum(sector, 59).reshape(-1)
        opaque = (picture.rgba[..., 3] > 0.5).reshape(-1)
        away = np.linalg.norm(beside, axis=-1).reshape(-1)
        in_reach = away < 1.4 * RADIUS
        share = np.bincount(sector[in_reach], opaque[in_reach], 60) / np.bincount(sector[in_reach], minlength=60)
        edges.append(1.4 * RADIUS * np.sqrt(share) - RADIUS)
        inner = away < 0.9 * RADIUS
        depths.append(np.linalg.norm(ends.reshape(-1, 3)[inner] - CENTER, axis=-1) - RADIUS)
    return rms(np.concatenate(edges)), float(np.mean([e.std() for e in edges])), rms(np.concatenate(depths))


def plane_errors(stage, smooth):
    """RMS distance of the depth from the plane, and its spread, in voxels."""
    _, _, ends, _ = seen(stage, majority(below_plane), (10.0, 15.0), CLEAR, {1: OPAQUE}, smooth)
    near = np.abs(ends - CENTER).max(axis=-1) < 9.0
    away = (ends[near] - CENTER) @ NORMAL - 1.3
    return rms(away), float(away.std())


@pytest.mark.parametrize("tf, functions", ((CLEAR, {1: OPAQUE}), (OPAQUE, {0: None})), ids=("shown", "cut out"))
def test_a_sphere_of_labels_has_the_outline_of_a_sphere(stage, tf, functions):
    edge, spread, depth = sphere_errors(stage, tf, functions, True)
    edge_before, spread_before, depth_before = sphere_errors(stage, tf, functions, False)
    # Measured: 0.48, 0.136 and 0.16 voxels, and 0.70, 0.171 and 0.43 where edges show the voxels.
    assert edge < 0.55 and depth < 0.2 and spread < 0.85 * spread_before
    assert edge_before > 0.65 and depth_before > 0.4, "the measurement sees the steps of the voxels"


POST = dict(classification="post", depth_rule="preintegrated-2")


def test_a_sphere_that_is_cut_out_under_post_classification(stage):
    """Labels that only hide leave the classification as it is."""
    edge, spread, depth = sphere_errors(stage, OPAQUE, {0: None}, True, **POST)
    # Measured: 0.47, 0.13 and 0.12 voxels.
    assert edge < 0.55 and depth < 0.2 and spread < 0.16


def half_hidden(stage, kind=np.uint8, **labeled):
    """Dim red tissue in front of and beside opaque white bone, as the labels say; seen along y."""
    volume = Volume(np.where(majority(in_sphere).voxels == 1, 200, 40).astype(kind), np.eye(4))
    tf = TransferFunction(
        opacity=((39.0, 0.05), (60.0, 0.05), (180.0, 1.0)), color=((60.0, 1, 0, 0), (180.0, 1, 1, 1)),
        opacity_unit_distance=1.0, shade=None,
    )  # fmt: skip
    scene = stage.on_turntable(np.zeros((N, N, N)), 20.0, 10.0, size=(64, 64), fit=1.0)
    return replace(scene, volume=volume, transfer_function=tf, **labeled)


@pytest.mark.parametrize("kind", (np.uint8, np.int16, np.float32))
def test_hidden_values_are_not_interpolated_into_what_is_seen(stage, kind):
    scene = half_hidden(stage, kind, labels=Labels(majority(in_sphere), {1: None}))
    picture = stage.render(scene, **POST)
    assert picture.report["plan"]["classification"] == "post" and not picture.report["remarks"]
    assert picture.rgba[..., 0].max() > 0.5 and picture.rgba[..., 1].max() < 1e-6, "nothing white is left"
    whole = stage.render(replace(scene, labels=None), **POST)
    assert whole.rgba[..., 1].max() > 0.5
    # What lies before and behind the bone: the tissue's own length, thinned out where the edge begins.
    as_voxels = stage.render(scene, classification="pre").rgba[..., 3]
    assert np.abs(picture.rgba[..., 3] - as_voxels)[8:-8, 8:-8].max() < 0.05


def test_labels_that_hide_nothing_change_nothing_under_post(stage):
    scene = half_hidden(stage)
    labels = Labels(majority(in_sphere), {7: None})
    one, other = (stage.render(each, **POST) for each in (scene, replace(scene, labels=labels)))
    np.testing.assert_allclose(one.rgba, other.rgba, atol=1e-6)
    scene = replace(scene, labels=Labels(majority(in_sphere), {1: None}))
    kernels, numpy = both(lambda: stage.render(scene, **POST))
    np.testing.assert_allclose(kernels.rgba, numpy.rgba, atol=1e-5)


def test_a_gradient_opacity_that_thins_nothing_changes_nothing_of_what_labels_hide(stage):
    scene = half_hidden(stage, labels=Labels(majority(in_sphere), {1: None}))
    thinned = replace(scene.transfer_function, gradient_opacity=GradientOpacity(0.0, 0.0))
    one, other = (stage.render(each, **POST) for each in (scene, replace(scene, transfer_function=thinned)))
    assert other.report["plan"]["classification"] == "post"
    np.testing.assert_array_equal(one.rgba, other.rgba)


def test_steps_of_voxels_or_colors_leave_the_classification(stage):
    for labels in (Labels(majority(in_sphere), {1: None}, smooth=False), Labels(majority(in_sphere), {1: OPAQUE})):
        picture = stage.render(half_hidden(stage, labels=labels), **POST)
        assert picture.report["plan"]["classification"] == "post" and not picture.report["remarks"]


def test_an_oblique_plane_of_labels_has_no_steps(stage):
    distance, steps = plane_errors(stage, True)
    distance_before, steps_before = plane_errors(stage, False)
    # Measured: 0.13 and 0.062 voxels, and 0.42 and 0.23 where edges show the voxels.
    assert distance < 0.17 and steps < 0.08 and distance_before > 0.4 and steps_before > 0.2


def random_numbers(kinds: int):
    """Function numbers in patches, and single voxels of another number."""
    random = np.random.default_rng(5)
    patches = random.integers(0, kinds, (3, 4, 5)).repeat(3, axis=0).repeat(3, axis=1).repeat(3, axis=2)
    return np.where(random.random(patches.shape) < 0.05, kinds, patches).astype(np.uint16)


def test_the_kernel_and_numpy_share_voxels_alike():
    numbers, hidden = random_numbers(4), np.array((False, True, False, False, True))
    for first, last in ((0, 9), (0, 4), (3, 9)):
        one, other = both(partial(edge_shares, numbers, hidden, first, last))
        for name in ("at", "voxel", "number", "source", "share"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_shares_are_those_of_the_definition():
    """In one voxel after another: the filtered indicator, sharpened, and hidden functions show nowhere."""
    numbers, hidden = random_numbers(3), np.array((False, True, False, False))
    found = edge_shares(numbers, hidden, 0, len(numbers))
    padded = np.pad(numbers, 1, mode="edge")
    weight = np.multiply.outer(np.multiply.outer((1, 2, 1), (1, 2, 1)), (1, 2, 1)) / 64
    shares = np.zeros((numbers.size, 4))
    for at, place in enumerate(np.ndindex(numbers.shape)):
        around = padded[tuple(slice(i, i + 3) for i in place)]
        coverage = np.array([weight[around == kind].sum() for kind in range(4)])
        mine = numbers[place]
        own = max(coverage[mine], 0.5)
        own = own**3 / (own**3 + (1 - own) ** 3)
        if own > 1 - 0.5 / 255:
            own = 1.0
        shares[at] = (1 - own) * coverage / max(1 - coverage[mine], 1e-9)
        shares[at, mine] = own
    shares[:, hidden] = 0.0
    expected = np.eye(4)[numbers.reshape(-1)] * ~hidden
    expected[found.at] = 0.0
    np.add.at(expected, (found.at[found.voxel], found.number), found.share)
    np.testing.assert_allclose(expected, shares, atol=1e-12)
    sources = numbers.reshape(-1)[found.source]
    shown = found.source == found.at[found.voxel]
    assert (sources[~shown] == found.number[~shown]).all(), "a hidden voxel takes the value of a neighbor"
    assert hidden[numbers.reshape(-1)[found.at[found.voxel]]][~shown].all() and not hidden[sources].any()


def classified(volume, tf, labels):
    mixed = Mixture(volume, tf, labels)
    bits = drain(mixed.mark_steps())
    return mixed.classify(gather_kept(volume, bits, count_kept(bits), drain(block_steps(volume))), 1.0)


def test_types_of_voxels_and_labels_make_no_difference():
    random = np.random.default_rng(2)
    labels = random_numbers(3).astype(np.uint8)
    voxels = random.integers(0, 200, labels.shape).astype(np.uint8)
    tf = TransferFunction(opacity=((50.0, 0.0), (200.0, 0.8)), color=((0.0, 1, 0, 0), (200.0, 0, 0, 1)))
    functions = {1: None, 2: evenly(0.3, (0.1, 0.9, 0.2)), 3: evenly(0.0)}
    found = [
        classified(Volume(voxels.astype(kind), np.eye(4)), tf, Labels(Volume(labels.astype(of), np.eye(4)), functions))
        for kind, of in ((np.uint8, np.uint8), (np.float32, np.uint8), (np.int16, np.int32))
    ]
    for other in found[1:]:
        np.testing.assert_array_equal(other.column, found[0].column)
        np.testing.assert_allclose(other.properties, found[0].properties, rtol=1e-6)


def test_numbers_of_voxels_have_64_bits_where_those_of_numpy_have_32(monkeypatch):
    """numpy 1 on Windows; a volume of 1300^3 voxels has more than 2^31."""
    arange, kinds = np.arange, []

    def narrow(*ends, **options):
        return arange(*ends, **{"dtype": np.int32 if all(isinstance(end, int) for end in ends) else None, **options})

    monkeypatch.setattr(np, "arange", narrow)
    monkeypatch.setattr(mixture.kernels, "add_channel", lambda indices, *rest: kinds.append(indices.dtype))
    classified(Volume(np.ones((3, 3, 3), np.uint8), np.eye(4)), OPAQUE, None)
    assert kinds == [np.int64]


def test_maps_without_an_edge_or_without_anything_to_see(stage):
    """No label has a function, or all are hidden: no edge, and edges that nothing shares."""
    scene = half_hidden(stage)
    plain = stage.render(scene, classification="pre")
    nothing = Volume(np.zeros((N, N, N), np.uint8), np.eye(4))
    same = stage.render(replace(scene, labels=Labels(nothing, {1: OPAQUE})), classification="pre")
    assert same.rgba.tobytes() == plain.rgba.tobytes()
    for classification in ("pre", "post"):
        hidden = replace(scene, labels=Labels(majority(in_sphere), {0: None, 1: None}))
        assert stage.render(hidden, classification=classification, depth_rule="slice").rgba.max() == 0.0


def test_what_is_hidden_never_shows_its_own_values():
    """Bright bone around dim tissue: where the bone is hidden, no voxel is as opaque or as white as bone."""
    labels = majority(in_sphere)
    volume = Volume(np.where(labels.voxels == 1, 40, 200).astype(np.uint8), np.eye(4))
    tf = TransferFunction(opacity=((40.0, 0.2), (200.0, 1.0)), color=((40.0, 1, 0, 0), (200.0, 1, 1, 1)))
    found = classified(volume, tf, Labels(labels, {0: None}))
    assert found.opacity.max() <= 0.2 + 1e-6 and found.color[:, 1].max() <= 1e-6
    assert found.visible_voxels > labels.voxels.sum(), "the edge reaches into hidden voxels"


def test_a_thin_label_stays():
    """A sheet, a line and a single voxel keep at least half of their opacity."""
    labels = np.zeros((9, 9, 20), np.uint8)
    labels[4, :, 2] = labels[4, 4, 6] = labels[4, 4, 12] = labels[:, :, 17] = 1
    volume = Volume(np.full(labels.shape, 100, np.uint8), np.eye(4))
    found = classified(volume, CLEAR, Labels(Volume(labels, np.eye(4)), {1: evenly(0.8)}))
    opacity = np.zeros(labels.size, np.float32)
    rows = np.repeat(np.arange(81), np.diff(found.row_start))
    opacity[rows * 20 + found.column] = found.opacity
    assert opacity.reshape(labels.shape)[labels == 1].min() >= 0.4 - 1e-6


def test_even_neighbors_of_one_look_keep_it():
    """Two labels of one opacity: their colors mix at the edge, and what absorbs light stays even."""
    labels = majority(in_sphere)
    volume = Volume(np.full(labels.voxels.shape, 100, np.uint8), np.eye(4))
    red, blue = (evenly(0.3, color) for color in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    found = classified(volume, red, Labels(labels, {1: blue}))
    np.testing.assert_allclose(found.opacity, 0.3, rtol=1e-6)
    np.testing.assert_allclose(found.color.sum(axis=1), 1.0, rtol=1e-6)
    assert ((found.color[:, 0] > 0.1) & (found.color[:, 2] > 0.1)).any()


def test_the_work_counts_in_the_estimate_of_memory(stage):
    scene = stage.on_turntable(np.zeros((N, N, N)), 0.0, 0.0, size=(8, 8))
    volume = Volume(np.full((N, N, N), 100, np.uint8), np.eye(4))
    scene = replace(scene, volume=volume, transfer_function=evenly(0.1))
    labels = Labels(majority(in_sphere), {1: OPAQUE})
    without, needed = (stage.render(one).report for one in (scene, replace(scene, labels=labels)))
    assert needed["memory_estimate_bytes"]["work"] >= 180 * N**3 > without["memory_estimate_bytes"]["work"]
