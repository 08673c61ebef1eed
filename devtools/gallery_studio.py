"""The studio of the gallery: camera, lights, worlds made of nodes (runs in an
environment with bpy).

Lengths are parts of the volume's largest side, so that scans of any size look alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import bpy
from demo_scene import box_of, material, named
from mathutils import Matrix, Vector

WARM, COLD = (1.0, 0.93, 0.84), (0.62, 0.78, 1.0)
RENDER = "render"  # the usual name of a picture


@dataclass
class Stage:
    """A volume object with the middle and the largest side of its box, the folder for files, and what it stands on."""

    volume: bpy.types.Object
    folder: Path
    middle: Vector
    size: float
    ground: tuple = ()

    @classmethod
    def of(cls, volume_object, folder: Path) -> Stage:
        bpy.context.view_layer.update()
        low, high = box_of(volume_object)
        return cls(volume_object, folder, (low + high) / 2, max(high - low))

    @property
    def settings(self):
        return bpy.context.scene.rle_splat

    @property
    def low(self) -> Vector:
        bpy.context.view_layer.update()
        return box_of(self.volume)[0]

    @property
    def foot(self) -> float:
        """The height of the volume's lowest slice above its middle, in sizes."""
        return (self.low.z - self.middle.z) / self.size

    def at(self, *place) -> Vector:
        """A place given from the middle, in sizes."""
        return self.middle + self.size * Vector(place)

    # --- the volume ---------------------------------------------------------------------------------------------------

    def read_labels(self, path: Path) -> None:
        """List the segments of a label file."""
        bpy.context.view_layer.objects.active = self.volume
        self.volume.rle_splat.label_file = str(path)
        bpy.ops.rle_splat.load_segments()

    # --- camera and light ---------------------------------------------------------------------------------------------

    def camera(self, toward, lens: float = 85.0, aim=(0.0, 0.0, 0.0)) -> bpy.types.Object:
        """The active camera, as far along ``toward`` as that is long, looking at ``aim`` from the middle."""
        target, eye = self.at(*aim), self.at(*toward)
        camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        bpy.context.scene.collection.objects.link(camera)
        camera.matrix_world = Matrix.Translation(eye) @ (target - eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
        camera.data.lens = lens
        camera.data.clip_start, camera.data.clip_end = 0.01 * self.size, 100.0 * self.size
        bpy.context.scene.camera = camera
        return camera

    def area(self, name: str, watts: float, place, color, side: float = 1.0, aim=(0.0, 0.0, 0.0), **settings):
        """An area light without shadows; ``watts`` are those of a volume of size one.  Only the key casts shadows:
        ambient occlusion darkens what is hidden from the others, and they light no back sides."""
        spot, target = self.at(*place), self.at(*aim)
        data = bpy.data.lights.new(name, "AREA")
        data.energy, data.color, data.size = watts * self.size**2, color, side * self.size
        data.use_shadow = False
        for key, value in settings.items():
            setattr(data, key, value)
        made = _placed(name, data, spot, target)
        if self.ground:  # what casts no shadow would wash the key's shadow out
            spare(name, made, self.ground)
        return made

    def key(self, strength: float, place, color=WARM) -> bpy.types.Object:
        """The sun of the studio, small enough for the shadows of contact to be dark."""
        return self.lamp("Key", "SUN", strength, place, color, angle=math.radians(3.0))

    def lamp(self, name: str, kind: str, energy: float, place, color, **settings):
        """A sun, point or spot light that shines toward the middle; lengths among its settings are in sizes."""
        data = bpy.data.lights.new(name, kind)
        data.energy, data.color = energy * (1.0 if kind == "SUN" else self.size**2), color
        if "shadow_soft_size" in settings:
            settings["shadow_soft_size"] *= self.size
        for key, value in settings.items():
            setattr(data, key, value)
        return _placed(name, data, self.at(*place), self.middle)

    def without_background(self, samples: int = 1) -> None:
        """Leave the background to what puts the picture together.  Without meshes Cycles then has nothing to do, and
        one sample is enough."""
        scene = bpy.context.scene
        scene.render.film_transparent = True
        scene.cycles.samples = samples
        scene.cycles.use_denoising = scene.cycles.use_denoising and samples > 1

    # --- what stands around -------------------------------------------------------------------------------------------

    def sweep(self, toward, height: float, color=(0.09, 0.095, 0.105)) -> bpy.types.Object:
        """A photographer's paper sweep for a camera ``toward`` from the middle: a floor ``height`` sizes above it that
        bends up into a wall behind the volume, for the shadow of the volume and of meshes."""
        away = -Vector((toward[0], toward[1], 0.0)).normalized()
        bend = [math.radians(90.0 * step / 24) for step in range(25)]
        profile = [(-9.0, 0.0), *((1.9 + math.sin(a), 1.0 - math.cos(a)) for a in bend), (2.9, 9.0)]
        across = away.cross(Vector((0.0, 0.0, 1.0)))
        places = [self.at(*(ahead * away + side * across + Vector((0.0, 0.0, height + up))))
                  for ahead, up in profile for side in (-9.0, 9.0)]  # fmt: skip
        mesh = bpy.data.meshes.new("Floor")
        mesh.from_pydata(places, [], [(n, n + 1, n + 3, n + 2) for n in range(0, len(places) - 2, 2)])
        mesh.materials.append(material("Paper", color, roughness=0.6))
        mesh.shade_smooth()
        floor = bpy.data.objects.new("Floor", mesh)
        bpy.context.scene.collection.objects.link(floor)
        self.ground = (floor,)
        return floor


def spare(name: str, light, objects) -> None:
    """Leave objects out of what a light shines on."""
    spared = bpy.data.collections.new(f"Not lit by {name}")
    for n, one in enumerate(objects):
        spared.objects.link(one)
        spared.collection_objects[n].light_linking.link_state = "EXCLUDE"
    light.light_linking.receiver_collection = spared


def _placed(name: str, data, spot, target):
    holder = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(holder)
    holder.matrix_world = Matrix.Translation(spot) @ (target - spot).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    return holder


def letters(body: str, place: Matrix, size: float, coat, align: str = "CENTER") -> None:
    """Text in the plane of x and y of a place."""
    curve = bpy.data.curves.new(body, "FONT")
    curve.body, curve.align_x, curve.align_y = body, align, "CENTER"
    curve.materials.append(coat)
    made = bpy.data.objects.new(body, curve)
    bpy.context.scene.collection.objects.link(made)
    made.matrix_world = place @ Matrix.Scale(size, 4)  # the size of a text has a minimum of 0.1 mm
    made.visible_shadow = False


def scale_bar(body: str, place: Matrix, length: float, size: float, coat) -> None:
    """A bar along x with its length above it, in letters of a size."""
    bpy.ops.mesh.primitive_cube_add(size=1.0)
    bar = named("Scale Bar", coat)
    bar.matrix_world, bar.visible_shadow = place @ Matrix.Diagonal((length, 0.13 * size, 0.07 * size, 1.0)), False
    letters(body, place @ Matrix.Translation((0.0, 0.9 * size, 0.0)), size, coat)


def emission(name: str, color):
    """A material that is as bright as its color, whatever the light."""
    made = material(name, (0.0, 0.0, 0.0), roughness=1.0)
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Emission Color"].default_value = (*color, 1.0)
    shader.inputs["Emission Strength"].default_value = 1.0
    return made


def _new_world():
    world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0, 0):
        world.use_nodes = True
    bpy.context.scene.world = world
    return world.node_tree


def flat_world(color) -> None:
    """A world of one color."""
    _new_world().nodes["Background"].inputs["Color"].default_value = (*color, 1.0)


def hdri_world(path: Path) -> None:
    """A world of an environment picture."""
    tree = _new_world()
    image = tree.nodes.new("ShaderNodeTexEnvironment")
    image.image = bpy.data.images.load(str(path))
    tree.links.new(image.outputs["Color"], tree.nodes["Background"].inputs["Color"])


def view_transform(name: str, look: str = "None", exposure: float = 0.0) -> None:
    settings = bpy.context.scene.view_settings
    settings.view_transform = name
    settings.look = look
    settings.exposure = exposure


def softbox_world(stage_colors, boxes, strength: float = 1.0) -> None:
    """A world as an HDRI of a photographer's studio has it, of nodes: a sky that goes from dark below to light above,
    and lamps with soft edges.

    ``stage_colors`` are the radiances straight down, at the horizon and straight up; each box is (direction, half angle
    in degrees, radiance).
    """
    tree = _new_world()
    background = tree.nodes["Background"]
    background.inputs["Strength"].default_value = strength
    direction = tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"]
    upward = _dot(tree, direction, (0.0, 0.0, 1.0))
    spread = tree.nodes.new("ShaderNodeMapRange")
    spread.inputs["From Min"].default_value = -1.0
    tree.links.new(upward, spread.inputs["Value"])
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    below, above = ramp.color_ramp.elements
    middle = ramp.color_ramp.elements.new(0.5)
    for element, color in zip((below, middle, above), stage_colors):
        element.color = (*color, 1.0)
    tree.links.new(spread.outputs["Result"], ramp.inputs["Fac"])
    total = ramp.outputs["Color"]
    for toward, degrees, radiance in boxes:
        total = _added(tree, total, _lamp_in_the_sky(tree, direction, toward, degrees), radiance)
    tree.links.new(total, background.inputs["Color"])


def _dot(tree, direction, toward):
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = "DOT_PRODUCT"
    node.inputs[1].default_value = Vector(toward).normalized()
    tree.links.new(direction, node.inputs[0])
    return node.outputs["Value"]


def _lamp_in_the_sky(tree, direction, toward, degrees: float):
    """1 within an angle around a direction, 0 outside of it, with a soft edge."""
    edge = tree.nodes.new("ShaderNodeMapRange")
    edge.interpolation_type = "SMOOTHSTEP"
    edge.inputs["From Min"].default_value = math.cos(math.radians(1.15 * degrees))
    edge.inputs["From Max"].default_value = math.cos(math.radians(0.85 * degrees))
    tree.links.new(_dot(tree, direction, toward), edge.inputs["Value"])
    return edge.outputs["Result"]


def _added(tree, color, factor, radiance):
    """A color plus ``factor`` times a radiance."""
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = "MULTIPLY_ADD"
    tree.links.new(factor, node.inputs[0])
    node.inputs[1].default_value = radiance
    tree.links.new(color, node.inputs[2])
    return node.outputs["Vector"]
