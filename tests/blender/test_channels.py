"""Proves that further volume objects add to a volume's picture, each by its own transfer function."""

import json

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

N, ALPHA = 9, 0.2
RED, BLUE = (0.9, 0.1, 0.1), (0.1, 0.2, 0.9)


@pytest.fixture
def pair(tmp_path):
    """Two homogeneous cubes on one grid, red and blue, the first active; seen from above."""
    made = []
    for name, color in (("second", BLUE), ("first", RED)):
        made.append(scenes.import_raw(tmp_path, np.full((N, N, N), 100, np.uint8), name=name))
        scenes.give_transfer(made[-1], ((0.0, 0.0), (50.0, ALPHA), (255.0, ALPHA)), color)
    scenes.add_camera(((N - 1) / 2, (N - 1) / 2, 30.0), type="ORTHO", ortho_scale=12.0)
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = 48
    bpy.context.scene.rle_splat.lighting = "NONE"
    second, first = made
    select(first, second)
    return first, second


def select(active, *others):
    for one in bpy.context.selected_objects:
        one.select_set(False)
    for one in (*others, active):
        one.select_set(True)
    bpy.context.view_layer.objects.active = active


def middle():
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    return scenes.image_pixels(bpy.context.scene.rle_splat.image)[20:28, 20:28].reshape(-1, 4).mean(axis=0)


def reported(name):
    report = json.loads(bpy.context.scene.rle_splat.last_report_json)
    return next(row for row in report["effects"] if row["name"] == name)


def test_extinctions_add_and_colors_by_their_share(pair):
    first, second = pair
    alone = middle()
    assert not reported("channels")["on"]
    assert bpy.ops.rle_splat.add_channels() == {"FINISHED"}
    assert [row.source for row in first.rle_splat.channels] == [second]
    both = middle()
    assert reported("channels")["on"] and "1 further channel" in reported("channels")["reason"]
    depth = -(N - 1) * np.log1p(-ALPHA)
    assert both[3] == pytest.approx(-np.expm1(-2.0 * depth), abs=2e-3)
    np.testing.assert_allclose(both[:3] / both[3], np.add(RED, BLUE) / 2.0, atol=5e-3)
    np.testing.assert_allclose(alone[:3] / alone[3], RED, atol=5e-3)

    first.rle_splat.channels[0].show = False
    np.testing.assert_array_equal(middle(), alone)
    first.rle_splat.channels[0].show = True
    np.testing.assert_array_equal(middle(), both)
    assert bpy.ops.rle_splat.remove_channel(index=0) == {"FINISHED"}
    assert len(first.rle_splat.channels) == 0 and second.name in bpy.data.objects
    np.testing.assert_array_equal(middle(), alone)


def test_the_channels_own_transfer_function_counts(pair):
    second = pair[1]
    bpy.ops.rle_splat.add_channels()
    scenes.give_transfer(second, ((0.0, 0.0), (255.0, 0.0)), BLUE)
    np.testing.assert_allclose(middle()[:3] / middle()[3], RED, atol=5e-3)
    assert "fully transparent" in reported("channels")["reason"]


def test_channels_survive_the_file_and_a_deleted_volume(pair, tmp_path):
    first, second = pair
    alone = middle()
    bpy.ops.rle_splat.add_channels()
    both, name, other = middle(), first.name, second.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    first, second = bpy.data.objects[name], bpy.data.objects[other]
    select(first, second)
    np.testing.assert_array_equal(middle(), both)
    bpy.data.objects.remove(second)
    np.testing.assert_array_equal(middle(), alone)


def test_what_cannot_be_a_channel_is_refused_in_a_sentence(pair, refused, tmp_path):
    first = pair[0]
    assert bpy.ops.rle_splat.add_channels() == {"FINISHED"}
    refused(bpy.ops.rle_splat.add_channels, "is already a channel of")
    small = scenes.import_raw(tmp_path, np.full((N, N, N - 2), 100, np.uint8), name="small")
    select(first, small)
    refused(bpy.ops.rle_splat.add_channels, "7 x 9 x 9 voxels")
    refused(lambda: bpy.ops.rle_splat.remove_channel(index=5), "no channel 5")
    select(first)
    assert not bpy.ops.rle_splat.add_channels.poll()


def test_channels_are_matched_by_their_places_in_the_patient(bridge, tmp_path, capfd, refused):
    """Stored in another order, on a coarser grid, or elsewhere; a window does it in steps."""
    nibabel = pytest.importorskip("nibabel")
    values = np.random.default_rng(1).integers(0, 255, (9, 8, 7)).astype(np.uint8)
    flip = np.diag((-1.0, 1, 1, 1))
    flip[0, 3] = 8.0
    affines = {
        "first": np.eye(4), "flipped": flip, "coarse": np.diag((2.0, 2.0, 2.0, 1.0)),
        "away": np.array([(1, 0, 0, 99), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1.0)]),
    }  # fmt: skip
    stored = {"first": values, "flipped": values[::-1], "coarse": values[::2, ::2, ::2], "away": values}
    made = {}
    for name, affine in affines.items():
        nibabel.save(nibabel.Nifti1Image(stored[name], affine), tmp_path / f"{name}.nii")
        bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / f"{name}.nii"))
        made[name] = bpy.context.view_layer.objects.active
    first, loading, channels = made["first"], bridge("volumes.loading"), bridge("volumes.channels")
    select(first, made["away"])
    refused(bpy.ops.rle_splat.add_channels, "lies elsewhere")
    select(first, made["flipped"], made["coarse"])
    steps = loading.missing_steps(first, further=[made["flipped"], made["coarse"]])
    assert "matching a channel to the volume" in {step.message for step in steps}
    capfd.readouterr()
    assert bpy.ops.rle_splat.add_channels() == {"FINISHED"}
    told = capfd.readouterr().out
    assert "in another order; they were reordered" in told and "another grid (5 x 4 x 4 voxels)" in told
    assert loading.missing_steps(first) is None and loading.is_at_hand(first)
    volume, depsgraph = bridge("volumes.volumes").load_volume(first), bpy.context.evaluated_depsgraph_get()
    found = {row.volume.name: row.volume for row in channels.read_channels(first, depsgraph, volume)}
    np.testing.assert_array_equal(found["flipped"].voxels, volume.voxels)
    assert found["coarse"].shape_xyz == volume.shape_xyz
    np.testing.assert_array_equal(found["coarse"].voxels[::2, ::2, ::2], volume.voxels[::2, ::2, ::2])
    bridge("volumes.volumes").forget_all()
    assert loading.missing_steps(first) is not None and not loading.is_at_hand(first)


def test_a_file_is_added_in_one_operator(bridge, tmp_path, capfd, refused):
    """Read, brought onto the grid of the active volume, which stays active; nothing is left of one that is refused."""
    nibabel = pytest.importorskip("nibabel")
    values = np.random.default_rng(1).integers(0, 255, (9, 8, 7)).astype(np.uint8)
    away = np.array([(1, 0, 0, 99), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1.0)])
    for name, stored, affine in (
        ("first", values, np.eye(4)), ("coarse", values[::2, ::2, ::2], np.diag((2.0, 2.0, 2.0, 1.0))),
        ("away", values, away),
    ):  # fmt: skip
        nibabel.save(nibabel.Nifti1Image(stored, affine), tmp_path / f"{name}.nii")
    assert not bpy.ops.rle_splat.import_channel.poll()
    bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / "first.nii"))
    owner = bpy.context.view_layer.objects.active
    before = set(bpy.data.objects)
    add = bpy.ops.rle_splat.import_channel
    refused(add, "lies elsewhere", filepath=str(tmp_path / "away.nii"))
    refused(add, "No file was chosen")
    refused(add, "holds 1 volumes", of_file=True)
    assert set(bpy.data.objects) == before and not owner.rle_splat.channels
    capfd.readouterr()
    assert add(filepath=str(tmp_path / "coarse.nii")) == {"FINISHED"}
    assert "another grid (5 x 4 x 4 voxels)" in capfd.readouterr().out
    assert bpy.context.view_layer.objects.active == owner and [one.name for one in bpy.context.selected_objects] == [
        owner.name
    ]
    (row,) = owner.rle_splat.channels
    assert row.source.name == "coarse" and bridge("volumes.loading").is_at_hand(owner)


def test_a_pet_that_is_added_is_hot(bridge, tmp_path):
    scenes.import_raw(tmp_path, np.full((N, N, N), 100, np.uint8))
    owner = bpy.context.view_layer.objects.active
    np.arange(N**3, dtype=np.uint16).tofile(tmp_path / "pet.raw")
    assert bpy.ops.rle_splat.import_channel(
        filepath=str(tmp_path / "pet.raw"), shape=(N, N, N), dtype="uint16", modality="PT"
    ) == {"FINISHED"}
    function = bridge("look.transfer").read_transfer(owner.rle_splat.channels[0].source)
    assert function.name == "PET Hot" and function.span == (pytest.approx(0.01 * N**3, abs=2), pytest.approx(
        0.999 * N**3, abs=2))  # fmt: skip


def test_channels_of_one_file_are_added_in_their_colors(bridge, tmp_path):
    """Green, magenta and cyan where the file says nothing; each with the window of its own values."""
    tifffile = pytest.importorskip("tifffile")
    values = np.random.default_rng(1).integers(0, 100, (N, 3, N, N)).astype(np.uint16)
    values[2:6, :, 2:6, 2:6] += 2000
    values[:, 1] *= 4
    tifffile.imwrite(tmp_path / "cells.tif", values, imagej=True, metadata={"axes": "ZCYX"})
    bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / "cells.tif"))
    owner = bpy.context.view_layer.objects.active
    assert bpy.ops.rle_splat.import_channel(of_file=True) == {"FINISHED"}
    sources = [owner, *(row.source for row in owner.rle_splat.channels)]
    functions = [bridge("look.transfer").read_transfer(one) for one in sources]
    assert [one.color[0][1:] for one in functions] == [(0, 1, 0), (1, 0, 1), (0, 1, 1)]
    windows = [one.span for one in functions]
    assert windows[1][1] == pytest.approx(4 * windows[0][1], rel=0.05) and windows[2] == pytest.approx(
        windows[0], rel=0.1
    )
    volume, depsgraph = bridge("volumes.volumes").load_volume(owner), bpy.context.evaluated_depsgraph_get()
    for i, channel in enumerate(bridge("volumes.channels").read_channels(owner, depsgraph, volume), 1):
        np.testing.assert_array_equal(channel.volume.voxels, values[:, i])
