"""Blender Volume objects that show a volume's medium to other render engines: their files, materials and places.

The file holds the grids of ``vdb_medium``, in the space of the volume object: its own units are world units.
"""

from dataclasses import replace

import bpy
import numpy as np

from ...rle_splat.pipeline.medium_grid import medium_steps
from ...rle_splat.read.vdb_medium import DENSITY, EMISSION, MediumFile
from ...rle_splat.scene import Scene
from ...rle_splat.volume.reduced import node_to_index
from .. import versions
from ..scene import render_scene
from ..volumes import volumes

LOOKS = [
    ("LIT", "As Lit Here", "Keep the light of this moment: the material absorbs, and emits the lit colors"),
    ("CYCLES", "Lit by Cycles", "Let the lights of the scene shine on it: the material scatters light in the unlit "
                                "colors"),
]  # fmt: skip

# Names of effects.
OF_LIGHT = ("shading", "lights", "headlight", "world light", "shadows", "ambient occlusion", "indirect light")
LONGEST_NAME = 40  # characters of the volume's name in names made of it


def file_steps(plain: Scene, quality, factors, path, residual=None):
    """Generator of Progress: write the medium of a scene to an OpenVDB file; returns its number of visible voxels.

    Parameters
    ----------
    quality : Quality
        Its threads count.
    factors : (fx, fy, fz)
        Voxels of the volume along each side of a voxel of the file.
    residual : ndarray, shape (4, 4), optional
        Space of the volume object to that of the object that shows the file, if they differ.

    Raises
    ------
    RleSplatError
        If the medium cannot be made, or the file cannot be written.
    """
    volumes.expose_modules()
    residual = np.eye(4) if residual is None else residual
    made = MediumFile(density_factor(plain.volume_matrix @ np.linalg.inv(residual)))
    visible = yield from medium_steps(plain, quality, factors, made.add, render_scene.KEPT)
    made.save(path, residual @ grid_matrix(plain, factors))
    return visible


def density_factor(matrix_world: np.ndarray) -> float:
    """What Blender divides the density of a volume by whose object has this matrix.

    Parameters
    ----------
    matrix_world : ndarray, shape (4, 4)
        The object's own space to the world.

    Returns
    -------
    float
        By how much it lengthens the diagonal of a cube; see ``BKE_volume_density_scale`` of Blender.
    """
    return float(np.linalg.norm(matrix_world[:3, :3] @ np.full(3, 1.0 / np.sqrt(3.0))))


def grid_matrix(plain: Scene, factors) -> np.ndarray:
    """(4, 4) float64: index of a voxel of the file, as this Blender places it, to the space of the volume object."""
    shift = np.eye(4)
    shift[:3, 3] = -versions.GRID_SAMPLE_AT
    scale = np.diag((plain.scene_scale,) * 3 + (1.0,))
    return scale @ plain.volume.affine @ node_to_index(factors) @ shift


def new_object(name: str, material):
    """A Volume object without a file, in no collection yet, that shows its grids by a material."""
    data = bpy.data.volumes.new(name)
    data.materials.append(material)
    return bpy.data.objects.new(name, data)


def emitting_material(name: str, engines: str = "ALL"):
    """A material that absorbs by the file's density and emits its lit colors, as our own pictures do.

    ``engines`` draw it: "ALL" or "CYCLES".
    """
    material, tree, output = _new_material(name)
    output.target = engines
    density, emission = _attribute(tree, DENSITY, 0), _attribute(tree, EMISSION, 1)
    absorb, emit, both = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("VolumeAbsorption", "Emission", "AddShader"))
    absorb.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    tree.links.new(density.outputs["Fac"], absorb.inputs["Density"])
    tree.links.new(emission.outputs["Color"], emit.inputs["Color"])
    tree.links.new(absorb.outputs[0], both.inputs[0])
    tree.links.new(emit.outputs[0], both.inputs[1])
    tree.links.new(both.outputs[0], output.inputs["Volume"])
    for column, row in ((absorb, 0), (emit, 1)):
        column.location = (220.0, -220.0 * row)
    both.location = (440.0, 0.0)
    return material


def scattering_material(name: str):
    """A Principled Volume of the file's density, in the colors that ``unlit`` leaves."""
    material, tree, output = _new_material(name)
    density, emission = _attribute(tree, DENSITY, 0), _attribute(tree, EMISSION, 1)
    divide = tree.nodes.new("ShaderNodeVectorMath")
    divide.operation, divide.location = "DIVIDE", (220.0, -220.0)
    principled = tree.nodes.new("ShaderNodeVolumePrincipled")
    principled.location = (440.0, 0.0)
    principled.inputs["Density Attribute"].default_value = ""  # else it would be multiplied in once more
    tree.links.new(emission.outputs["Vector"], divide.inputs[0])
    tree.links.new(density.outputs["Fac"], divide.inputs[1])
    tree.links.new(density.outputs["Fac"], principled.inputs["Density"])
    tree.links.new(divide.outputs["Vector"], principled.inputs["Color"])
    tree.links.new(principled.outputs[0], output.inputs["Volume"])
    return material


def unlit(plain: Scene) -> Scene:
    """The scene in the colors of the transfer function, for a material that light falls on."""
    function = replace(plain.transfer_function, shade=None)
    return replace(plain, transfer_function=function, effects={
        name: on for name, on in plain.effects.items() if name not in OF_LIGHT})  # fmt: skip


def _new_material(name: str) -> tuple:
    """A material with nothing but its output: (material, tree, output node)."""
    material = bpy.data.materials.new(name)
    tree = versions.material_tree(material)
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.location = (660.0, 0.0)
    return material, tree, output


def _attribute(tree, name: str, row: int):
    """A node that reads a grid."""
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name, node.location = name, (0.0, -220.0 * row)
    return node
