"""OpenVDB grids that Cycles shows without this add-on, and whether it shows any.

Cycles has grids from NanoVDB alone.  A Blender built without it, as Debian's 5.2 is, reads VDB files and draws a
material's even volume, but no grid.  No build option that Python sees tells of it, so such a Blender is asked.
"""

import subprocess

import bpy
import numpy as np
import pytest

from tests.blender import scenes

bpy.utils.expose_bundled_modules()
import openvdb  # noqa: E402  (within reach only after the line above)

SIZE = (32, 28)


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
            "ShaderNodeAddShader", "ShaderNodeOutputMaterial"))  # fmt: skip
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
    subprocess.run([*command, "--render-frame", "1"], check=True, capture_output=True)
    if not scenes.load_pixels(folder / "alone1.exr").any():
        pytest.skip("this Blender's Cycles draws no grids, with no add-on either: built without NanoVDB")


def needs_any_grid(folder):
    """Skip when Cycles shows nothing of a ball of light."""
    extinction = np.ones((4, 4, 4))
    volume_of(folder / "light.vdb", extinction, np.ones((4, 4, 4, 3)), np.eye(4))
    scenes.add_camera((1.5, 1.5, 20.0), type="ORTHO", ortho_scale=8.0)
    scenes.use_cycles(SIZE, samples=4)
    needs_grids(folder)
