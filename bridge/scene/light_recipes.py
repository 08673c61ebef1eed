"""The lights of the lighting recipes as plain data, for a viewer of the volume and in sizes of the volume.

A place is (right, away, up) from the middle of the volume: to the right of the picture, away from the viewer, and up in
the picture.  Lengths are shares of the volume's longest side.  Watts are those of a side of one world unit: they grow
with its square.  The guide's pictures are made with these lights, see devtools/gallery_light.py.
"""

from dataclasses import dataclass, field

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
    type: str
    power: float
    place: tuple
    color: tuple
    size: float = 1.0
    casts_shadow: bool = True


@dataclass(frozen=True)
class Recipe:
    """Lights, and the properties that they look best with.

    Parameters
    ----------
    lights : tuple of RecipeLight
    scene : dict
        Properties of ``scene.rle_splat``.  Every recipe sets all of them, so that none depends on the one before.
    volume : dict
        Properties of ``volume.rle_splat``.  The next recipe brings back those that it does not set itself.
    """

    lights: tuple
    scene: dict
    volume: dict = field(default_factory=dict)


def _settings(ambient_occlusion: float = 0.0, indirect_light: float = 0.0) -> dict:
    return {"use_shadows": True, "ambient_occlusion": ambient_occlusion, "indirect_light": indirect_light}


SMOOTHEST = 0.015  # of the longest side: a recipe's smoothness is at most this, for small animals and specimens
RECIPES = {
    "THREE": Recipe(
        (
            RecipeLight("Key", "AREA", 60.0, (-1.85, -0.72, 1.19), PALE),
            RecipeLight("Fill", "AREA", 6.0, (1.03, -1.93, -0.05), COLD, size=2.0, casts_shadow=False),
            RecipeLight("Rim", "AREA", 130.0, (1.73, 1.16, 1.13), COLD),
        ),
        _settings(ambient_occlusion=0.7),
    ),
    "BONE": Recipe(
        (
            RecipeLight("Sun", "SUN", 4.2, (-1.71, -1.11, 1.1), PALE, size=SUN),
            RecipeLight("Rim", "AREA", 80.0, (1.93, 0.72, 0.97), COLD),
        ),
        _settings(ambient_occlusion=0.7),
    ),
    "SOFT": Recipe(
        (
            RecipeLight("Key", "AREA", 54.0, (-1.9, -0.4, 1.2), PALE),
            RecipeLight("Fill", "AREA", 30.0, (1.5, -1.5, 0.1), COOL),
        ),
        _settings(ambient_occlusion=0.6),
    ),
    "SKIN": Recipe(
        (
            RecipeLight("Key", "AREA", 30.0, (-1.2, -1.5, 0.7), PALE),
            RecipeLight("Rim", "AREA", 80.0, (1.8, 0.8, 0.5), WARM, size=0.6),
        ),
        _settings(ambient_occlusion=0.7, indirect_light=0.5),
        {"smoothness": 3.5, "specular": 0.0},
    ),
    "SMOKE": Recipe(
        (
            RecipeLight("Warm Sun", "SUN", 9.0, (1.27, -1.03, 0.08), ORANGE, size=0.009),
            RecipeLight("Cold Sun", "SUN", 9.0, (-1.61, -0.33, 0.75), BLUE, size=0.009),
        ),
        _settings(),
        {"use_shading": True, "ambient": 0.1, "diffuse": 1.0},
    ),
    "SPECIMEN": Recipe(
        (
            RecipeLight("Sun", "SUN", 3.6, (-1.62, -0.43, 0.58), WARM, size=SUN),
            RecipeLight("Rim", "AREA", 110.0, (1.78, 0.15, 0.81), COLD),
        ),
        _settings(ambient_occlusion=0.7),
    ),
}
