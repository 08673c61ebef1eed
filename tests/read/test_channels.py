"""Channels are matched to a volume by their places: reordered exactly, interpolated on another grid, or refused."""

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.read.channels import read_channel
from rle_splat.read.formats import write_volume
from rle_splat.runtime.steps import drain
from rle_splat.scene import Camera, Channel, Labels, RleSplatError, Scene
from rle_splat.volume.regrid import on_grid_steps
from rle_splat.volume.volume import PATIENT, Volume

from .phantoms import AFFINES, rotation
from .test_labels import SCAN, SHAPE, labels_on, nearest, points, turned

SLOPES, OFFSET = np.array((0.7, -0.4, 1.1)), 90.0  # a value that is linear in the place


def channel_on(affine, shape, dtype=np.float32, **more) -> Volume:
    """A volume whose value is linear in the place."""
    empty = Volume(np.zeros(shape[::-1], dtype), affine)
    values = points(empty) @ SLOPES + OFFSET
    values = np.rint(values) if np.dtype(dtype).kind == "i" else values
    return Volume(values.astype(dtype), affine, space=PATIENT, **more)


def on_scan(channel) -> Volume:
    return drain(on_grid_steps(channel, SCAN, values=True))


@pytest.mark.parametrize("flips, order", [((-1, 1, 1), (0, 1, 2)), ((1, -1, -1), (2, 0, 1)), ((1, 1, 1), (1, 0, 2))])
def test_flips_and_orders_are_undone_exactly(flips, order):
    channel = labels_on(*turned(flips, order))
    found = on_scan(channel)
    np.testing.assert_array_equal(found.voxels, nearest(channel, SCAN))
    assert found.remarks == ("The channel stores its voxels in another order; they were reordered.",)


@pytest.mark.parametrize("dtype, error", [(np.float32, 1e-3), (np.float64, 1e-9), (np.int16, 1.0)])
@pytest.mark.parametrize("turn", [0, 25])
def test_values_on_another_grid_are_interpolated(dtype, error, turn):
    """A field that is linear in the place comes back; half of the error of integers is that of the channel itself."""
    middle = points(SCAN)[3, 3, 3]
    affine = np.eye(4)
    affine[:3, :3] = AFFINES["oblique"][:3, :3] @ rotation(turn, 0)[:3, :3] * 0.83
    affine[:3, 3] = middle - affine[:3, :3] @ (15, 15, 15)
    found = on_scan(channel_on(affine, (31, 31, 31), dtype))
    assert found.voxels.dtype == dtype and found.shape_xyz == SHAPE
    np.testing.assert_allclose(found.voxels, points(SCAN) @ SLOPES + OFFSET, atol=error)
    assert found.remarks == ("The channel has another grid (31 x 31 x 31 voxels); its values were interpolated.",)


def test_a_channel_is_read_onto_the_scan_with_options_of_its_file(tmp_path):
    channel = channel_on(SCAN.affine, SHAPE, value_unit="HU")
    write_volume(channel, tmp_path / "channel.nrrd")
    found = read_channel(tmp_path / "channel.nrrd", SCAN, value_unit="SUVbw")
    np.testing.assert_array_equal(found.voxels, channel.voxels)
    assert found.value_unit == "SUVbw"
    np.testing.assert_array_equal(read_channel(channel, SCAN).voxels, channel.voxels)
    channel.voxels.tofile(tmp_path / "channel.raw")
    raw = read_channel(tmp_path / "channel.raw", SCAN, shape=SHAPE, dtype="float32", spacing=SCAN.spacing)
    np.testing.assert_array_equal(raw.voxels, channel.voxels)


@pytest.mark.parametrize("slope", [1.0, -2.0])
def test_outside_is_the_lowest_value(slope):
    affine = AFFINES["oblique"].copy()
    affine[:3, 3] += affine[:3, 0] * 2.3
    channel = channel_on(affine, SHAPE, slope=slope, intercept=5.0)
    found = on_scan(channel)
    inside = np.arange(SHAPE[0]) >= 2
    expected = (points(SCAN) @ SLOPES + OFFSET)[..., 3:]
    np.testing.assert_allclose(found.voxels[..., 3:], expected, atol=1e-3)
    lowest = channel.physical(channel.voxels).min()
    np.testing.assert_allclose(found.physical(found.voxels)[..., ~inside], lowest, rtol=1e-6)
    assert "25% of the volume lie outside it" in found.remarks[0]


def test_nan_beside_a_voxel_of_the_same_place_does_no_harm():
    affine = AFFINES["oblique"] @ np.diag((1.0, 1.0, 0.5, 1.0))  # every second slice is one of the scan
    channel = channel_on(affine, (SHAPE[0], SHAPE[1], 2 * SHAPE[2]))
    voxels = channel.voxels.copy()
    voxels[1::2] = np.nan
    found = on_scan(Volume(voxels, affine, space=PATIENT))
    np.testing.assert_allclose(found.voxels, points(SCAN) @ SLOPES + OFFSET, atol=1e-3)


def test_another_place_is_refused():
    affine = AFFINES["oblique"].copy()
    affine[:3, 3] += 500.0
    with pytest.raises(RleSplatError, match=r"The channel lies elsewhere.*choose a channel of this scan"):
        on_scan(channel_on(affine, SHAPE))


def test_a_scene_refuses_further_volumes_of_another_place():
    affine, shape = turned((-1, 1, 1), (0, 1, 2))
    clear = TransferFunction(opacity=((0.0, 0.0),), color=((0.0, 1, 1, 1),))
    for more in (
        {"channels": (Channel(channel_on(affine, shape), clear),)}, {"labels": Labels(labels_on(affine, shape))},
    ):  # fmt: skip
        with pytest.raises(
            RleSplatError, match="elsewhere than the volume, or its spacing differs; give one on the same"
        ):
            Scene(SCAN, clear, Camera(), **more)
    Scene(SCAN, clear, Camera(), channels=(Channel(on_scan(channel_on(affine, shape)), clear),))


def test_a_scene_refuses_further_arrays_of_another_spacing():
    clear = TransferFunction(opacity=((0.0, 0.0),), color=((0.0, 1, 1, 1),))
    scan, same, finer = (
        Volume(np.zeros(SHAPE[::-1], np.uint8), np.diag((side, 1.0, 2.0, 1.0))) for side in (1, 1, 0.5)
    )
    for more in ({"channels": (Channel(finer, clear),)}, {"labels": Labels(finer)}):
        with pytest.raises(RleSplatError, match="its spacing differs"):
            Scene(scan, clear, Camera(), **more)
    Scene(scan, clear, Camera(), channels=(Channel(same, clear),), labels=Labels(same))
