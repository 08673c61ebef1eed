"""Lighting recipes: lights as plain data, for a viewer of the volume and in sizes of the volume, and a scene with them.

A place is (right, away, up) from the middle of the volume: to the right of the picture, away from the viewer, and up in
the picture.  Lengths are shares of the volume's longest side.  Watts are those of a side of one world unit: they grow
with its square.  The guide's pictures are made with these lights, see devtools/gallery_light.py.
"""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from ..classify.transfer_function import Shade
from ..classify.visible_box import visible_reach
from ..scene import Light, RleSplatError, Scene
from ..scene.light import LightType
from ..view.look_at import look_at

LightRecipe = Literal["three", "bone", "soft", "skin", "smoke", "specimen"]
PALE, WARM, ORANGE = (1.0, 0.93, 0.84), (1.0, 0.8, 0.6), (1.0, 0.45, 0.12)
COOL, COLD, BLUE = (0.85, 0.92, 1.0), (0.62, 0.78, 1.0), (0.3, 0.55, 1.0)
SUN = 0.05  # radians, about 3 degrees: the edges of shadows are a little soft


@dataclass(frozen=True)
class RecipeLight:
    """A light that shines toward the middle of the volume.

    Parameters
    ----------
    name : str
    type : {"SUN", "AREA"}
    power : float
        W/m^2 for a sun, else W for a volume whose longest side is one world unit.
    place : (3,) tuple of float
        Right, away and up.
    color : (3,) tuple of float
        Scene-linear.
    size : float
        Side of an area light; radians for a sun.
    casts_shadow : bool
    """

    name: str
    type: LightType
    power: float
    place: tuple
    color: tuple
    size: float = 1.0
    casts_shadow: bool = True


@dataclass(frozen=True)
class Recipe:
    """Lights that cast shadows, and what they look best with.

    Parameters
    ----------
    lights : tuple of RecipeLight
    ambient_occlusion, indirect_light : float
        Of the scene.  Every recipe sets both, so that none depends on the one before.
    shade : dict
        Parameters of Shade.
    turns_shading_on : bool
        Whether an unshaded transfer function becomes a shaded one.
    """

    lights: tuple
    ambient_occlusion: float = 0.0
    indirect_light: float = 0.0
    shade: dict = field(default_factory=dict)
    turns_shading_on: bool = False

    def shade_for(self, side: float) -> dict:
        """Parameters of Shade for a volume whose longest side is ``side``, in its unit of length."""
        most = {"smoothness": SMOOTHEST * side} if "smoothness" in self.shade else {}
        return {name: min(value, most.get(name, value)) for name, value in self.shade.items()}

    def lights_for(self, middle, turn, side: float) -> tuple[Light, ...]:
        """The lights in world units.

        Parameters
        ----------
        middle : (3,) ndarray of float64
            Of what is visible.
        turn : (3, 3) ndarray of float64
            Right, up and backward of the viewer, unit vectors as columns.
        side : float
            The longest side of the volume.
        """
        found = []
        for light in self.lights:
            right, away, up = light.place
            matrix = look_at(middle + side * (turn @ (right, up, -away)), middle, turn[:, 1])
            made = Light(light.type, light.color, light.power, matrix, casts_shadow=light.casts_shadow)
            if light.type == "SUN":
                found.append(replace(made, angle=light.size))
            else:
                found.append(replace(made, energy=light.power * side**2, size=light.size * side))
        return tuple(found)


SMOOTHEST = 0.015  # of the longest side: a recipe's smoothness is at most this, for small animals and specimens
RECIPES: dict[LightRecipe, Recipe] = {
    "three": Recipe(
        (
            RecipeLight("Key", "AREA", 60.0, (-1.85, -0.72, 1.19), PALE),
            RecipeLight("Fill", "AREA", 6.0, (1.03, -1.93, -0.05), COLD, size=2.0, casts_shadow=False),
            RecipeLight("Rim", "AREA", 130.0, (1.73, 1.16, 1.13), COLD),
        ),
        ambient_occlusion=0.7,
    ),
    "bone": Recipe(
        (
            RecipeLight("Sun", "SUN", 4.2, (-1.71, -1.11, 1.1), PALE, size=SUN),
            RecipeLight("Rim", "AREA", 80.0, (1.93, 0.72, 0.97), COLD),
        ),
        ambient_occlusion=0.7,
    ),
    "soft": Recipe(
        (
            RecipeLight("Key", "AREA", 54.0, (-1.9, -0.4, 1.2), PALE),
            RecipeLight("Fill", "AREA", 30.0, (1.5, -1.5, 0.1), COOL),
        ),
        ambient_occlusion=0.6,
    ),
    "skin": Recipe(
        (
            RecipeLight("Key", "AREA", 45.0, (-1.7, -0.9, 0.9), PALE),
            RecipeLight("Fill", "AREA", 8.0, (1.3, -1.6, 0.0), COOL, size=2.0, casts_shadow=False),
            RecipeLight("Rim", "AREA", 60.0, (1.7, 1.1, 0.6), WARM, size=0.7),
        ),
        ambient_occlusion=0.7,
        indirect_light=0.5,
        shade={"smoothness": 3.5, "specular": 0.15, "shininess": 12.0},
    ),
    "smoke": Recipe(
        (
            RecipeLight("Warm Sun", "SUN", 9.0, (1.27, -1.03, 0.08), ORANGE, size=0.009),
            RecipeLight("Cold Sun", "SUN", 9.0, (-1.61, -0.33, 0.75), BLUE, size=0.009),
        ),
        shade={"ambient": 0.1, "diffuse": 1.0},
        turns_shading_on=True,
    ),
    "specimen": Recipe(
        (
            RecipeLight("Sun", "SUN", 3.6, (-1.62, -0.43, 0.58), WARM, size=SUN),
            RecipeLight("Rim", "AREA", 110.0, (1.78, 0.15, 0.81), COLD),
        ),
        ambient_occlusion=0.7,
    ),
}


def add_lights(scene: Scene, recipe: LightRecipe = "three") -> Scene:
    """Light a scene by a lighting recipe, as *Add Lights* does in Blender.

    Parameters
    ----------
    scene : Scene
        Left and right of the lights are those of its camera. Its own lights and its world stay.
    recipe : {"three", "bone", "soft", "skin", "smoke", "specimen"}
        The guide *Lighting recipes* has pictures.

    Returns
    -------
    Scene
        With the recipe's lights, shadows, ambient occlusion and scattering, and without a headlight. "skin" and "smoke"
        change the shading of the transfer functions, too.

    Raises
    ------
    RleSplatError
        For an unknown recipe.
    """
    if recipe not in RECIPES:
        raise RleSplatError(f"There is no light recipe {recipe!r}; choose {', '.join(RECIPES)}.")
    chosen, volume = RECIPES[recipe], scene.volume
    last = np.array(volume.shape_xyz) - 1.0
    seen = visible_reach(volume, scene.transfer_function, scene.labels) if volume.holds_values else None
    middle = (scene.index_to_world @ (*(0.5 * np.sum(seen or (0.0 * last, last), axis=0)), 1.0))[:3]
    turn = scene.camera.matrix_world[:3, :3] / np.linalg.norm(scene.camera.matrix_world[:3, :3], axis=0)
    side = float((np.linalg.norm(scene.index_to_world[:3, :3], axis=0) * last).max())
    changes = chosen.shade_for(float((volume.spacing * last).max()))

    def shaded(function):
        shade = Shade() if function.shade is None and chosen.turns_shading_on else function.shade
        return function if shade is None else replace(function, shade=replace(shade, **changes))

    labels = scene.labels
    if labels is not None:
        labels = replace(labels, functions={label: one and shaded(one) for label, one in labels.functions.items()})
    return replace(
        scene, lights=(*scene.lights, *chosen.lights_for(middle, turn, side)), headlight=False, volume_shadows=True,
        ambient_occlusion=chosen.ambient_occlusion, indirect_light=chosen.indirect_light, labels=labels,
        transfer_function=shaded(scene.transfer_function),
    )  # fmt: skip
