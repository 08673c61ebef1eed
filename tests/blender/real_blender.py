"""The extension in a real Blender executable, without a window:

    blender --background --factory-startup --python-exit-code 1 --python tests/blender/real_blender.py

RLE_SPLAT_EXTENSION_ZIP names the zip to install.  Any failure is an exception, so Blender ends with code 1.
"""

import json
import math
import os
import tempfile
from pathlib import Path

import bpy
import numpy as np

from tests.blender.scenes import module

MODULE = "bl_ext.user_default.rle_splat"
N = 9  # voxels a side of a uniform cube at unit spacing
ALPHA = 0.08  # per world unit
COLOR = (0.9, 0.5, 0.2)
SIZE = 64
VIEW = 12.0  # world units across the picture
TOLERANCE = 1.0 / 255.0


def install() -> None:
    done = bpy.ops.extensions.package_install_files(
        repo="user_default", filepath=os.environ["RLE_SPLAT_EXTENSION_ZIP"], enable_on_install=True, overwrite=True
    )
    assert done == {"FINISHED"} and MODULE in bpy.context.preferences.addons


def enable() -> bool:
    """Enable the extension; False where this user has not installed it."""
    if not Path(bpy.utils.user_resource("EXTENSIONS"), "user_default", "rle_splat").is_dir():
        return False
    assert bpy.ops.preferences.addon_enable(module=MODULE) == {"FINISHED"}
    return True


def import_cube(folder: Path):
    path = folder / "cube.raw"
    path.write_bytes(np.full((N, N, N), 100, np.uint8).tobytes())
    bpy.context.scene.rle_splat.scene_scale = 1.0
    bpy.context.scene.rle_splat.classification = "pre"  # its closed form has the ramps over the face voxels
    done = bpy.ops.rle_splat.import_volume(filepath=str(path), shape=(N, N, N), dtype="uint8", spacing=(1, 1, 1))
    assert done == {"FINISHED"}
    volume = bpy.context.view_layer.objects.active
    functions = module("rle_splat.classify.transfer_function")
    module("bridge.look.transfer").write_transfer(volume, functions.TransferFunction(
        name="test", unit=None, opacity=((0.0, 0.0), (50.0, ALPHA), (255.0, ALPHA)),
        color=((0.0, *COLOR), (255.0, *COLOR)), opacity_unit_distance=1.0, shade=None))  # fmt: skip
    return volume


def set_up_scene() -> None:
    scene = bpy.context.scene
    for other in tuple(bpy.data.objects):
        bpy.data.objects.remove(other)
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    scene.render.film_transparent = True
    scene.render.compositor_device = "CPU"
    data = bpy.data.cameras.new("Camera")
    data.type, data.ortho_scale = "ORTHO", VIEW
    camera = bpy.data.objects.new("Camera", data)
    camera.location = ((N - 1) / 2, (N - 1) / 2, 30.0)
    scene.collection.objects.link(camera)
    scene.camera = camera


def add_strip(x0, x1, z, color) -> None:
    """A rectangle at height z that emits ``color``."""
    mesh = bpy.data.meshes.new("strip")
    mesh.from_pydata([(x0, -2, z), (x1, -2, z), (x1, 10, z), (x0, 10, z)], [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new("emission")
    if material.node_tree is None:
        material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    shader, output = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value = (*color, 1.0)
    material.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    mesh.materials.append(material)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("strip", mesh))


def pixels_of(image) -> np.ndarray:
    flat = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(image.size[1], image.size[0], 4)[::-1]


def write_exr(path: Path) -> None:
    """Have renders written to ``path`` as 32-bit EXR."""
    render = bpy.context.scene.render
    if hasattr(render.image_settings, "media_type"):
        render.image_settings.media_type = "IMAGE"
    render.image_settings.file_format, render.image_settings.color_mode = "OPEN_EXR", "RGBA"
    render.image_settings.color_depth = "32"
    render.filepath = str(path)


def column_of(x: float) -> int:
    return int((x - (N - 1) / 2) / VIEW * SIZE + SIZE / 2)


def over(length, below=(0.0, 0.0, 0.0), below_alpha=0.0) -> np.ndarray:
    """RGBA of ``length`` units of the medium over what is below, by the exponential law."""
    alpha = 1.0 - (1.0 - ALPHA) ** length
    return np.array((*(alpha * np.array(COLOR) + (1.0 - alpha) * np.array(below)), alpha + (1.0 - alpha) * below_alpha))


def check_render_image() -> None:
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    settings = bpy.context.scene.rle_splat
    picture, depth = pixels_of(settings.image), pixels_of(settings.depth_image)[..., 0]
    np.testing.assert_allclose(picture[SIZE // 2, SIZE // 2], over(N), atol=TOLERANCE)
    assert np.abs(picture[1, 1]).max() == 0.0
    units = math.log(0.5) / math.log(1.0 - ALPHA)  # until half the light is left; half a unit in the upper ramp
    assert abs(depth[SIZE // 2, SIZE // 2] - (30.0 - (N - 0.5 - units))) < 0.02
    assert json.loads(settings.last_report_json)["image"] == {"width": SIZE, "height": SIZE}


def check_backdrop() -> None:
    assert bpy.ops.rle_splat.preview_in_camera_view(place="BACK") == {"FINISHED"}
    entry = bpy.context.scene.camera.data.background_images[0]
    assert entry.frame_method == "STRETCH" and tuple(entry.image.size) == (SIZE, SIZE)


def check_composite(folder: Path) -> None:
    front, inside, behind = (1.0, 0.1, 0.1), (0.1, 1.0, 0.1), (0.1, 0.1, 1.0)
    add_strip(0.0, 1.5, 15.0, front)
    add_strip(2.0, 3.5, 2.3, inside)
    add_strip(6.0, 7.0, -5.0, behind)
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    assert bpy.context.scene.render.use_lock_interface
    write_exr(folder / "out.exr")
    bpy.ops.render.render(write_still=True)
    picture = pixels_of(bpy.data.images.load(str(folder / "out.exr")))
    row = picture[SIZE // 2]
    expected = {0.8: over(0.0, front, 1.0), 2.8: over(N - 0.5 - 2.3, inside, 1.0), 4.8: over(N),
                6.5: over(N, behind, 1.0)}  # fmt: skip
    for x, rgba in expected.items():
        np.testing.assert_allclose(row[column_of(x)], rgba, atol=TOLERANCE, err_msg=f"at x = {x}")


def check_reload(folder: Path) -> None:
    before = pixels_of(bpy.context.scene.rle_splat.image).copy()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(folder / "scene.blend"))
    np.testing.assert_array_equal(pixels_of(bpy.context.scene.rle_splat.image), before)
    bpy.ops.rle_splat.render_image()


def main() -> None:
    install()
    passed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        set_up_scene()
        import_cube(folder)
        for check in (check_render_image, check_backdrop):
            check()
            passed += 1
        for check in (check_composite, check_reload):
            check(folder)
            passed += 1
    backend = module("rle_splat.runtime.jit")
    kernels = "numba" if backend.compiled() else f"numpy ({backend.NUMBA_PROBLEM})"
    print(f"{passed} passed, 0 failed, 0 skipped")
    print(f"REAL BLENDER PASSED {bpy.app.version_string} with {kernels}", flush=True)


if __name__ == "__main__":
    main()
