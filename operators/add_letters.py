"""Add Letters and Scale Bar: what viewports draw over a volume, as objects, which renders show too."""

import bpy
from mathutils import Matrix, Vector

from ..bridge import linked, versions
from ..bridge.data.settings import scene_scale_of
from ..bridge.live import bars, letters
from ..bridge.volumes import attached, box, volumes
from .refusal import refuse
from .through_camera import has_volume_and_camera

MARK = "rle_splat_letters"  # custom property: the name of the volume that an object is for
SIZE, LONGEST, MARGIN = 0.045, 0.25, 0.04  # of a letter, of the bar and of the space beside it, shares of the picture
ALONG = 0.9  # cosine with the view above which letters lie in front of the volume and behind it
RAYS = ("visible_diffuse", "visible_glossy", "visible_transmission", "visible_volume_scatter", "visible_shadow")


class RLE_SPLAT_OT_add_letters(bpy.types.Operator):
    """Add the letters of the patient's sides and a scale bar as objects, which renders show. The letters turn to the
    camera; in perspective the bar is true in the middle of the volume. Press again after moving the camera"""

    bl_idname = "rle_splat.add_letters"
    bl_label = "Add Letters and Scale Bar"
    bl_options = {"REGISTER", "UNDO"}

    poll = classmethod(has_volume_and_camera)

    def execute(self, context):
        owner, scene, camera = volumes.volume_object(context), context.scene, context.scene.camera
        corners, frame = box.world_corners(owner), camera.matrix_world.normalized()
        from_camera = frame.inverted()
        depths = [-(from_camera @ Vector(corner)).z for corner in corners.tolist()]
        if not depths or (middle := 0.5 * (min(depths) + max(depths))) <= 0.0:
            return refuse(self, "The camera does not see the volume; turn it to the volume.")
        for one in [one for one in scene.objects if one.get(MARK) == owner.name]:
            bpy.data.objects.remove(one)
        edges = camera.data.view_frame(scene=scene)
        in_perspective = camera.data.type != "ORTHO"
        left, bottom = (min(corner[axis] for corner in edges) for axis in (0, 1))
        height, width = (max(corner[axis] for corner in edges) - least for axis, least in ((1, bottom), (0, left)))
        near = -edges[0].z  # where the picture has this width and height, in perspective
        coat = _emission()
        found = letters.placed_letters(owner)
        for pair in zip(found[::2], found[1::2]):
            places = [Vector(place.tolist()) for _, place in pair]
            if abs((places[1] - places[0]).normalized().dot(frame.col[2].xyz)) > ALONG:
                continue
            for (letter, _), place in zip(pair, places):
                size = SIZE * height * (-(from_camera @ place).z / near if in_perspective else 1.0)
                matrix = Matrix.Translation(place) @ frame.to_3x3().to_4x4() @ Matrix.Scale(size, 4)
                one = _new(context, owner, letter, _text(letter), coat)
                attached.attach(one, owner, matrix)
                one.constraints.new("COPY_ROTATION").target = camera
        # The bar hangs at the camera, before the volume, and is as long as the same length in the volume's middle.
        distance = max(0.9 * min(depths), 1.01 * camera.data.clip_start)
        a_unit = scene_scale_of(scene, owner.rle_splat.length_unit) * (near / middle if in_perspective else 1.0)
        length = bars.length_of_bar(a_unit, LONGEST * width)
        title, size = f"{length:g} {owner.rle_splat.length_unit}", SIZE * height
        corner = frame @ Matrix.Translation((0.0, 0.0, -distance))
        corner = corner @ Matrix.Scale(distance / near if in_perspective else 1.0, 4)
        corner = corner @ Matrix.Translation((left + MARGIN * width, bottom + MARGIN * width, 0.0))
        mesh = bpy.data.meshes.new("Scale Bar")
        mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [], [(0, 1, 2, 3)])
        for name, data, matrix in (
            ("Scale Bar", mesh, Matrix.Diagonal((length * a_unit, 0.15 * size, 1.0, 1.0))),
            (title, _text(title, "LEFT"), Matrix.Translation((0.0, 0.9 * size, 0.0)) @ Matrix.Scale(0.8 * size, 4)),
        ):
            attached.attach(_new(context, owner, name, data, coat), camera, corner @ matrix)
        return {"FINISHED"}


def _text(body: str, align: str = "CENTER"):
    curve = bpy.data.curves.new(body, "FONT")
    curve.body, curve.align_x, curve.align_y = body, align, "CENTER"
    return curve


def _new(context, owner, name: str, data, coat):
    """An object without shadow and reflection, in a material."""
    one = bpy.data.objects.new(name, data)
    data.materials.append(coat)
    linked.put_into_scene(context, one)
    one[MARK] = owner.name
    for ray in RAYS:
        setattr(one, ray, False)
    return one


def _emission():
    """A white material, whatever the light."""
    material = bpy.data.materials.new("Letters")
    tree = versions.material_tree(material)
    tree.nodes.clear()
    emission, output = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Emission", "OutputMaterial"))
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return material
