"""Add Lights: the lights of a recipe, fitted to the volume's size and place, and the settings that go with them."""

from contextlib import suppress

import bpy
import numpy as np
from bpy.app.translations import pgettext_iface
from bpy.props import EnumProperty
from mathutils import Matrix

from ..bridge import linked
from ..bridge.data.settings import scene_scale_of
from ..bridge.scene import viewports
from ..bridge.translations import filled
from ..bridge.volumes import box, volumes
from ..rle_splat.scene import MODES, RleSplatError
from ..rle_splat.shade.light_recipes import RECIPES
from .add_cutting_object import visible_corners
from .reading import LoadsFirst
from .refusal import has_editable_values, refuses

MARK = "rle_splat_lights"  # custom property of the collection and of its lights: the name of the volume they are for
BEFORE = "rle_splat_before_lights"  # of the volume: what the last recipe changed of it, as (value before, value set)
FROM_THE_FRONT = Matrix.Rotation(np.pi / 2.0, 3, "X")  # the view along +Y, with +Z up


class RLE_SPLAT_OT_add_lights(LoadsFirst, bpy.types.Operator):
    """Add lights for one kind of scan, fitted to the volume, in place of those that this button added before. Sets
    Light Source, Shadows, Ambient Occlusion and Scattering, too. Another recipe restores the surface settings that For
    Skin and For Smoke change"""

    bl_idname = "rle_splat.add_lights"
    bl_label = "Add Lights"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(
        name="Recipe",
        description="Lights, and the settings that go with them",
        items=[
            ("THREE", "Three Lights", "Organs and vessels, to try first: a key light from the upper left, a weak fill "
             "light and a bright rim light"),
            ("BONE", "For Bone", "Skulls, fractures and implants: a sun from the upper left and a bluish rim light"),
            ("SOFT", "Soft Lights", "Brains and folded surfaces, pictures for teaching: two large soft lights from the "
             "left and the right"),
            ("SKIN", "For Skin", "Heads and faces: a key light from the left, a weak fill light and a warm rim "
             "light, which scatter in skin"),
            ("SMOKE", "For Smoke", "Smoke and clouds: an orange sun from the right and a blue one from the left"),
            ("SPECIMEN", "For Specimens", "Insects, shells and engines: a sun from the left, which shows the texture "
             "of a surface, and a rim light"),
        ],
    )  # fmt: skip

    poll = classmethod(has_editable_values)

    @refuses
    def execute(self, context):
        owner, scene, recipe = volumes.volume_object(context), context.scene, RECIPES[self.kind.lower()]
        context.view_layer.update()  # a script may just have placed the camera
        side = _longest_side(owner)
        corners = visible_corners(owner, scene)
        middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        home = _emptied_collection(owner, scene)
        for light, placed in zip(recipe.lights, recipe.lights_for(middle, _turn_of_view(context), side)):
            one = bpy.data.objects.new(light.name, _light_data(light.name, placed))
            one[MARK] = owner.name
            home.objects.link(one)
            one.matrix_world = Matrix(placed.matrix_world.tolist())
        labels = _apply_settings(owner, scene, recipe, side)
        if owner.rle_splat.mode == MODES[0]:
            names = ", ".join(light.name for light in recipe.lights)
            said = filled("Added {lights}, and set {settings}.", lights=names, settings=", ".join(labels))
            self.report({"INFO"}, said)
        else:
            said = filled("The lights have no effect in this mode; set Mode to Volume Rendering in Display.")
            self.report({"WARNING"}, said)
        return {"FINISHED"}


def _longest_side(owner) -> float:
    """Of the volume's box, world units."""
    corners = box.checked_corners(owner)
    side = float(np.linalg.norm(corners[[1, 2, 4]] - corners[0], axis=1).max())
    if not side > 0.0:
        raise RleSplatError(f"{owner.name} has a scale of 0; set it above 0.")
    return side


def _turn_of_view(context) -> np.ndarray:
    """The axes of the active camera; without one of the 3D viewport, and without both of a view from the front.

    Returns
    -------
    (3, 3) ndarray of float64
        Right, up and backward, as columns.
    """
    turn = FROM_THE_FRONT
    if context.scene.camera is not None:
        turn = context.scene.camera.matrix_world
    else:
        with suppress(RleSplatError):
            turn = Matrix(viewports.view_of(context)[0].tolist())
    return np.array(turn.to_quaternion().to_matrix(), np.float64)


def _emptied_collection(owner, scene):
    """The collection of a volume's lights without those that an earlier call has added; a new one if there is none."""
    found = (one for one in scene.collection.children_recursive if one.get(MARK) == owner.name and linked.is_own(one))
    home = next(found, None)
    if home is None:
        home = bpy.data.collections.new(f"Lights of {owner.name}")
        home[MARK] = owner.name
        scene.collection.children.link(home)
    before = [one for one in home.objects if one.get(MARK) == owner.name and linked.is_own(one)]
    lamps = {one.data for one in before if one.type == "LIGHT"}
    bpy.data.batch_remove(before)
    bpy.data.batch_remove([data for data in lamps if data.users == 0])
    return home


def _light_data(name: str, light):
    """A new light datablock like a Light."""
    data = bpy.data.lights.new(name, light.type)
    data.color, data.energy, data.use_shadow = light.color, light.energy, light.casts_shadow
    if light.type == "SUN":
        data.angle = light.angle
    else:
        data.size = light.size
    return data


def _apply_settings(owner, scene, recipe, side: float) -> list[str]:
    """Set what goes with a recipe, and return the labels of it, without effects of the scene that it turns off."""
    unit = scene_scale_of(scene, owner.rle_splat.length_unit) * owner.matrix_world.median_scale
    of_recipe = ({"use_shading": True} if recipe.turns_shading_on else {}) | recipe.shade_for(side / unit)
    before = _settings_before(owner)
    labels = []
    of_volume = {"lighting": "SCENE", **before, **of_recipe}
    before = {name: before.get(name, getattr(owner.rle_splat, name)) for name in of_recipe}
    of_scene = {
        "use_shadows": True, "ambient_occlusion": recipe.ambient_occlusion, "indirect_light": recipe.indirect_light
    }  # fmt: skip
    for group, values in ((owner.rle_splat, of_volume), (scene.rle_splat, of_scene)):
        for name, value in values.items():
            setattr(group, name, value)
            if group == owner.rle_splat or value:
                labels.append(pgettext_iface(group.bl_rna.properties[name].name))
    owner[BEFORE] = {name: (value, getattr(owner.rle_splat, name)) for name, value in before.items()}
    return labels


def _settings_before(owner) -> dict:
    """The settings that the last recipe changed, as they were before; without those that were changed since."""
    return {name: was for name, (was, now) in owner.get(BEFORE, {}).items() if getattr(owner.rle_splat, name) == now}
