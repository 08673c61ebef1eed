"""Several volumes and instances of them in one render, against transmittances on paper.

Cubes of N voxels a side at unit spacing; with its ramps each is N units deep, from z = -1/2 to N - 1/2.
"""

from collections import Counter
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from tests.blender import scenes
from tests.blender.conftest import MODULE

pytestmark = pytest.mark.usefixtures("by_numpy", "classified_first")

N, SIZE, VIEW = 9, 24, 12.0
RED, BLUE = (0.9, 0.3, 0.1), (0.1, 0.4, 0.8)
ALPHA = {"red": 0.06, "blue": 0.1}  # per unit


@pytest.fixture
def cubes(tmp_path):
    """A red and a blue cube in the same place, seen from above; included in renders."""
    found = {}
    for name, color in (("blue", BLUE), ("red", RED)):
        found[name] = owner = scenes.import_raw(tmp_path, np.full((N, N, N), 100, np.uint8), name=name)
        owner.location = (0.0, 0.0, 0.0)
        alpha = ALPHA[name]
        scenes.give_transfer(owner, ((0.0, 0.0), (50.0, alpha), (255.0, alpha)), color)
    scenes.use_cycles((SIZE, SIZE))
    middle = (N - 1) / 2
    scenes.add_camera((middle, middle, 40.0), type="ORTHO", ortho_scale=VIEW)
    settings = bpy.context.scene.rle_splat
    settings.quality = "fine"
    bpy.context.view_layer.objects.active = found["red"]
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    return found


def depth(name, length):
    return -np.log1p(-ALPHA[name]) * length


def over(*layers):
    """RGBA of layers from near to far, each a list of (optical depth, color) in the same place."""
    rgb, left = np.zeros(3), 1.0
    for layer in layers:
        whole = sum(tau for tau, _ in layer)
        rgb += left * (1.0 - np.exp(-whole)) * sum(tau * np.array(color) for tau, color in layer) / whole
        left *= np.exp(-whole)
    return np.array((*rgb, 1.0 - left))


def middle_of(picture):
    return picture[SIZE // 2 - 4 : SIZE // 2 + 4, SIZE // 2 - 4 : SIZE // 2 + 4]


def agree(picture, rgba):
    np.testing.assert_allclose(middle_of(picture), np.broadcast_to(rgba, (8, 8, 4)), atol=2.5 / 255.0)


def move_to_collection(one, name):
    """Take an object out of the scene into a collection of its own, and show an instance of that."""
    collection = bpy.data.collections.new(name)
    for holder in one.users_collection:
        holder.objects.unlink(one)
    collection.objects.link(one)
    instancer = bpy.data.objects.new(f"{name} instance", None)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
    bpy.context.scene.collection.objects.link(instancer)
    return instancer


def test_cubes_that_overlap_are_mixed(cubes, tmp_path):
    cubes["red"].location.z = 5.0
    expected = over(
        [(depth("red", 5.0), RED)], [(depth("red", 4.0), RED), (depth("blue", 4.0), BLUE)], [(depth("blue", 5.0), BLUE)]
    )
    picture = scenes.rendered(tmp_path / "out.exr")
    agree(picture, expected)
    assert "mixed" in bpy.context.scene.rle_splat.last_report_json
    cubes["red"].name = "a first"  # read in another order
    np.testing.assert_allclose(scenes.rendered(tmp_path / "out.exr"), picture, atol=1e-6)


def test_cubes_apart_and_one_that_is_hidden(cubes, tmp_path):
    cubes["red"].location.z = 12.0
    agree(scenes.rendered(tmp_path / "out.exr"), over([(depth("red", N), RED)], [(depth("blue", N), BLUE)]))
    cubes["red"].location.z = -12.0
    agree(scenes.rendered(tmp_path / "out.exr"), over([(depth("blue", N), BLUE)], [(depth("red", N), RED)]))
    cubes["red"].hide_render = True
    agree(scenes.rendered(tmp_path / "out.exr"), over([(depth("blue", N), BLUE)]))
    cubes["blue"].hide_render = True
    assert not scenes.rendered(tmp_path / "out.exr")[..., 3].any()
    assert "'red' is not in the picture: it is hidden from renders" in bpy.context.scene.rle_splat.render_problem


def test_including_a_volume_says_which_others_renders_show(cubes, capfd):
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    said = capfd.readouterr().out
    assert "red is now included in every render. " in said
    assert "Also included: blue. To leave a volume out, hide it from renders in the Outliner." in said


@pytest.mark.parametrize("bad", ["file", "scale"])
def test_a_volume_that_cannot_be_drawn_is_left_out_and_named(bad, cubes, bridge, tmp_path):
    cubes["red"].location.z = 12.0
    if bad == "file":  # found while the scene is read
        (tmp_path / "red.raw").unlink()
        bridge("loop.store").forget_all()
    else:  # found while the picture is made
        cubes["red"].scale = 0.0, 1.0, 1.0
    agree(scenes.rendered(tmp_path / "out.exr"), over([(depth("blue", N), BLUE)]))
    settings = bpy.context.scene.rle_splat
    assert settings.render_problem.startswith("'red' is left out of the picture: ") and settings.failed_frames == "1"
    cubes["blue"].scale = 0.0, 1.0, 1.0
    picture = scenes.rendered(tmp_path / "out.exr")  # nothing is left: a placeholder
    assert picture[..., 3].min() == 1.0 and "left out" not in settings.render_problem


def test_an_instance_is_the_volume_moved_there(cubes, tmp_path):
    cubes["blue"].hide_render = True
    red = cubes["red"]
    red.location, red.rotation_euler = (2.0, -1.0, 3.0), (0.1, 0.2, 0.3)
    bpy.context.view_layer.update()
    moved = scenes.rendered(tmp_path / "out.exr")
    red.location = (0.0, 1.0, 1.0)
    instancer = move_to_collection(red, "asset")
    instancer.location = (2.0, -2.0, 2.0)
    bpy.context.view_layer.update()
    picture = scenes.rendered(tmp_path / "out.exr")
    assert moved[..., 3].max() > 0.3
    np.testing.assert_allclose(picture, moved, atol=1e-5)
    red.hide_viewport = True  # counts in viewports alone
    np.testing.assert_array_equal(scenes.rendered(tmp_path / "out.exr"), picture)
    for one in (red, instancer):
        one.hide_render = True
        assert not scenes.rendered(tmp_path / "out.exr")[..., 3].any()
        one.hide_render = False
    instancer.hide_render = True
    assert not scenes.rendered(tmp_path / "out.exr")[..., 3].any()


def test_two_instances_and_their_clip_objects(cubes, bridge):
    cubes["blue"].hide_render = True
    red = cubes["red"]
    plane = bridge("scene.clip_objects").add_clip(bpy.context.scene, red, "PLANE", "INSIDE", np.eye(4))
    instancer = move_to_collection(red, "asset")
    instancer.location.z = 20.0
    other = instancer.copy()
    bpy.context.scene.collection.objects.link(other)
    other.location.z = 40.0
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    placed = bridge("scene.placements").shown(depsgraph)
    assert [one.stands_for.name for one in placed] == sorted((instancer.name, other.name)) and plane.parent == red
    plain, problems, _ = bridge("scene.render_scene").read_scenes(placed, depsgraph, with_meshes=True)
    assert not problems
    heights = sorted((scene.volume_matrix[2, 3], scene.clips[0].matrix_world[2, 3]) for scene in plain.values())
    np.testing.assert_allclose(heights, ((20.0, 20.0), (40.0, 40.0)), atol=1e-6)


def test_the_volume_left_is_rendered_after_the_other_was_deleted(cubes, tmp_path):
    settings = bpy.context.scene.rle_splat
    assert settings.composite_object == cubes["red"]
    with bpy.context.temp_override(selected_objects=[cubes["red"]]):
        bpy.ops.object.delete()
    agree(scenes.rendered(tmp_path / "out.exr"), over([(depth("blue", N), BLUE)]))
    assert settings.render_problem == "" and settings.composite_object == cubes["blue"]


@pytest.fixture
def reads(bridge, monkeypatch):
    """How often a file was read, or a channel brought onto a grid."""
    count = Counter()
    for module, name in (
        ("volumes.volumes", "file_steps"), ("volumes.labels", "read_label_steps"), ("volumes.channels", "on_grid_steps")
    ):  # fmt: skip
        steps = getattr(bridge(module), name)

        def counted(*given, name=name, steps=steps, **more):
            count[name] += 1
            return steps(*given, **more)

        monkeypatch.setattr(bridge(module), name, counted)
    return count


def redraws(bridge, owners, most=6) -> int:
    """How often a viewport that shows volumes is redrawn until no file is being read, each time after the timer."""
    request = bridge("live.viewport").Request(None, tuple(map(bridge("loop.index").key_of, owners)))
    surface = bridge("live.surface").BlenderSurface(bpy.context, request, None, [])
    for count in range(most):
        if None not in surface.contents(request, False).values():
            return count
        while bridge("loop.work")._tick() is not None:
            pass
    raise AssertionError("it never settles")


def give_labels(owner, folder):
    """A label file of its own for a cube, one of whose labels is hidden."""
    path = folder / f"{owner.name} labels.raw"
    np.tri(N, N * N, dtype=np.uint8).tofile(path)
    owner.rle_splat.label_file = str(path)
    scenes.activate(owner)
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    owner.rle_splat.labels[1].show = False


@pytest.mark.parametrize("case", ["unread", "labels", "a channel on two grids"])
def test_files_of_several_volumes_are_read_once(case, bridge, tmp_path, reads):
    voxels = np.full((N, N, N), 100, np.uint8)
    pair = [scenes.import_raw(tmp_path, voxels, (side,) * 3, f"cube {side}") for side in (1.0, 2.0)]
    expected = {"file_steps": 2}
    if case == "labels":
        for owner in pair:
            give_labels(owner, tmp_path)
        expected["read_label_steps"] = 2
    elif case != "unread":
        channel = scenes.import_raw(tmp_path, voxels, name="channel")
        for owner in pair:
            scenes.activate(owner, channel)
            assert bpy.ops.rle_splat.add_channels() == {"FINISHED"}
        expected = {"file_steps": 3, "on_grid_steps": 2}
    bridge("volumes.volumes").forget_all()
    reads.clear()
    assert redraws(bridge, pair) == 1 and reads == expected
    assert redraws(bridge, pair) == 0 and reads == expected


def test_a_volume_in_two_scenes_at_two_times_keeps_both_frames(bridge, tmp_path, reads):
    for frame in (1, 2):
        np.full((N, N, N), frame, np.uint8).tofile(tmp_path / f"beat_{frame}.raw")
    bpy.ops.rle_splat.import_volume(
        filepath=str(tmp_path / "beat_1.raw"), shape=(N, N, N), dtype="uint8", use_sequence=True
    )
    owner, first, second = bpy.context.view_layer.objects.active, bpy.context.scene, bpy.data.scenes.new("second")
    second.collection.objects.link(owner)
    first.frame_set(1)
    second.frame_set(2)
    for _ in range(3):
        for scene in (first, second):
            with scenes.in_scene(scene):
                depsgraph = bpy.context.evaluated_depsgraph_get()
                volume = bridge("volumes.volumes").load_volume(owner, depsgraph=depsgraph)
                assert volume.voxels.max() == scene.frame_current
    assert reads["file_steps"] == 2
    bpy.data.scenes.remove(second)
    bpy.context.view_layer.update()
    assert len(bridge("loop.store")._entries) == 1


def test_what_nothing_shows_leaves_the_memory(bridge, tmp_path):
    """After a deletion, a change of labels, a new file, and disabling; one that is hidden stays."""
    store = bridge("loop.store")
    pair = [scenes.import_raw(tmp_path, np.full((N, N, N), 100, np.uint8), name=name) for name in ("one", "two")]
    for owner in pair:
        give_labels(owner, tmp_path)
    assert redraws(bridge, pair) == 0 and store.nbytes() == 4 * N**3
    pair[0].rle_splat.label_file = ""
    pair[1].hide_set(True)
    redraws(bridge, pair)
    assert store.nbytes() == 3 * N**3
    bpy.data.objects.remove(pair[1])
    bpy.context.view_layer.update()
    assert store.nbytes() == N**3
    scenes.activate(pair[0])
    bpy.ops.object.delete()
    bpy.context.view_layer.update()
    assert store.nbytes() == 0
    scenes.import_raw(tmp_path, np.full((N, N, N), 100, np.uint8))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert store.nbytes() == 0
    scenes.import_raw(tmp_path, np.full((N, N, N), 100, np.uint8))
    assert store.nbytes() > 0
    bpy.ops.preferences.addon_disable(module=MODULE)
    assert store.nbytes() == 0


def test_mapped_files_take_no_memory(bridge, core, tmp_path, monkeypatch):
    scenes.import_raw(tmp_path, np.full((N, N, N), 100, np.uint8), name="held")
    monkeypatch.setattr(core("read.streaming"), "LEAST_MAPPED", 0)
    scenes.import_raw(tmp_path, np.full((N, N, N), 100, np.uint8), name="mapped")
    assert bridge("loop.store").nbytes() == N**3


@pytest.mark.parametrize("shown", [True, False])
def test_beyond_the_limit_what_no_window_shows_leaves_first(shown, bridge, tmp_path, monkeypatch):
    store, voxels = bridge("loop.store"), np.full((N, N, N), 100, np.uint8)
    monkeypatch.setattr(store, "bpy", SimpleNamespace(app=SimpleNamespace(
        background=False, is_job_running=lambda _name: False), context=bpy.context, data=bpy.data))  # fmt: skip
    monkeypatch.setattr(store, "MOST_BYTES", 2 * N**3)
    first = scenes.import_raw(tmp_path, voxels, name="first")
    monkeypatch.setattr(store, "_shown_objects", lambda: {first.session_uid} if shown else set())
    owners = [first] + [scenes.import_raw(tmp_path, voxels, name=name) for name in ("second", "third")]
    assert [bridge("volumes.volumes").is_at_hand(owner) for owner in owners] == [shown, not shown, True]
