"""The truth T1 against a program that is not ours (G14): Cycles marches the same grid of extinction and emission.

Cycles interpolates the grid linearly before anything else happens to it, so with a linear material its picture is
the integral of the interpolated classified medium.  It takes random steps, so a pixel is noisy; the mean is not.

Cycles has grids from NanoVDB alone.  A Blender built without it, as Debian's 5.2 is, reads VDB files and draws a
material's even volume, but no grid.  No build option that Python sees tells of it, so such a Blender is asked.
"""

import subprocess

import bpy
import numpy as np
import pytest
from mathutils import Vector

from benchmarks.phantoms import blobs
from tests.blender import scenes

bpy.utils.expose_bundled_modules()
import openvdb  # noqa: E402  (within reach only after the line above)

SIZE = (32, 28)
# Up to 4.5 Cycles takes a voxel's value for the middle of its cell [i, i + 1], from 5.0 on for the place i itself.
SAMPLE_AT = 0.5 if bpy.app.version < (5, 0) else 0.0
PLAIN = np.eye(4)
STRETCHED = np.array([[0.8, 0.0, 0.0, 3.0], [0.0, 1.0, 0.3, -2.0], [0.0, 0.0, 1.3, 1.0], [0.0, 0.0, 0.0, 1.0]])


def grid(kind, values, name, matrix):
    """A grid of (nz, ny, nx, ...) values whose first voxel is (-2, -2, -2)."""
    made = kind()
    made.name = name
    made.copyFromArray(np.ascontiguousarray(np.swapaxes(values, 0, 2)), ijk=(-2, -2, -2))
    made.transform = openvdb.createLinearTransform(matrix.T.tolist())
    return made


def volume_of(path, extinction, color, matrix):
    """A volume object that absorbs by ``extinction`` (nz, ny, nx) and emits extinction * color per world unit.

    Two transparent voxels all round: Cycles fills [0, n] about the centers, our medium ramps down to [-1, n].
    """
    fields = np.concatenate((color * extinction[..., None], extinction[..., None]), axis=-1)
    fields = np.pad(fields, ((2, 2),) * 3 + ((0, 0),)).astype(np.float32)
    grids = [
        grid(openvdb.FloatGrid, fields[..., 3], "density", matrix),
        grid(openvdb.Vec3SGrid, fields[..., :3], "source", matrix),
    ]
    openvdb.write(str(path), grids=grids)
    data = bpy.data.volumes.new("volume")
    data.filepath = str(path)
    data.materials.append(linear_material())
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("volume", data))


def linear_material():
    """Absorbs by the grid "density" and emits the grid "source"."""
    material = bpy.data.materials.new("linear")
    if material.node_tree is None:  # always there from 5.0 on
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    density, source, absorb, emit, both, output = (
        tree.nodes.new(kind) for kind in (
            "ShaderNodeAttribute", "ShaderNodeAttribute", "ShaderNodeVolumeAbsorption", "ShaderNodeEmission",
            "ShaderNodeAddShader", "ShaderNodeOutputMaterial"))
    density.attribute_name, source.attribute_name = "density", "source"
    absorb.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    tree.links.new(density.outputs["Fac"], absorb.inputs["Density"])
    tree.links.new(source.outputs["Color"], emit.inputs["Color"])
    tree.links.new(absorb.outputs[0], both.inputs[0])
    tree.links.new(emit.outputs[0], both.inputs[1])
    tree.links.new(both.outputs[0], output.inputs["Volume"])
    return material


def march(path):
    """Cycles' picture, ten steps a voxel and rays through the middles of the pixels."""
    cycles = scenes.use_cycles(SIZE, samples=24).cycles
    cycles.filter_width = 0.01
    cycles.volume_step_rate, cycles.volume_max_steps = 0.1, 4096
    if hasattr(cycles, "volume_biased"):  # from 5.0 on marching is a choice
        cycles.volume_biased = True
    return scenes.rendered(path).astype(np.float64)


def needs_grids(folder):
    """Skip when Cycles leaves the scene just as empty in a new process of this executable, where no add-on is.

    As the module bpy Blender comes from its makers, with NanoVDB, and has no executable to ask.
    """
    if not bpy.app.binary_path:
        return
    scenes.write_exr(folder / "alone#.exr")  # the number of the frame
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "alone.blend"), copy=True)
    command = [bpy.app.binary_path, "--background", "--factory-startup", str(folder / "alone.blend")]
    subprocess.run([*command, "--render-frame", "1"], check=True, capture_output=True, timeout=120)
    if not scenes.load_pixels(folder / "alone1.exr").any():
        pytest.skip("this Blender's Cycles draws no grids, with no add-on either: built without NanoVDB")


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("matrix", [PLAIN, STRETCHED], ids=["plain", "stretched"])
def test_cycles_sees_the_interpolated_classified_medium(core, tmp_path, matrix, kind):
    """Mean and noise agree in every channel; a truth moved by half a voxel along any axis does not."""
    field = blobs((18, 16, 14), 4, width=(1.5, 2.6)).astype(np.float64)
    extinction = -np.log1p(-field)
    z, y, x = np.indices(extinction.shape)
    color = np.stack((x / 17.0, y / 15.0, z / 13.0), axis=-1)
    volume_of(tmp_path / "medium.vdb", extinction, color, matrix)
    middle = (matrix @ (8.5, 7.5, 6.5, 1.0))[:3]
    away = np.array((25.0, -29.5, 13.5))
    camera = scenes.add_camera(middle + away, type=kind, ortho_scale=24.0, lens=58.0)
    camera.rotation_euler = Vector(-away).to_track_quat("-Z", "Y").to_euler()
    bpy.context.view_layer.update()
    ours = core("scene").Camera(np.array(camera.matrix_world), kind, lens=58.0, ortho_scale=24.0)
    rays = core("accuracy.rays").camera_rays(ours, *SIZE)
    medium = core("accuracy.medium").ClassifiedMedium(extinction, color)
    picture = march(tmp_path / "marched.exr").reshape(-1, 4)
    if not picture.any():
        needs_grids(tmp_path)

    def levels(moved=(0.0, 0.0, 0.0)):
        """(N, 4) difference from the truth of a volume moved by so many voxels."""
        place = matrix.copy()
        place[:3, 3] += matrix[:3, :3] @ (SAMPLE_AT + np.array(moved))
        return 255.0 * (picture - core("accuracy.integrate").integrate(medium, rays, place, tolerance=1e-6)[0])

    error = levels()
    assert picture[:, 3].max() > 0.9
    rmse = np.sqrt((error**2).mean())
    print(f"Cycles {bpy.app.version_string}: RMSE {rmse:.2f}, bias {np.abs(error.mean(axis=0)).max():.3f} levels")
    assert rmse < 1.0 and np.abs(error.mean(axis=0)).max() < 0.15
    for axis in range(3):
        for way in (-0.5, 0.5):
            assert np.sqrt((levels(way * np.eye(3)[axis]) ** 2).mean()) > 4.0 * rmse
