"""The effects of light: shading, light objects, a headlight, highlights."""

from collections import Counter

from ..classify.transfer_function import Shade
from ..scene import MODES, Quality, Scene
from ..scene.changed import change
from .kind import Kind
from .ray_mode import MODE_NAMES

BAKED = "baked into the .rle file"


def _unlit_because(scene: Scene) -> str | None:
    """Why nothing is shaded; None where something is."""
    if not scene.volume.holds_values:
        return BAKED
    if scene.mode != MODES[0]:
        return f"nothing is lit in the mode {MODE_NAMES[scene.mode]}"
    if scene.transfer_function.shade is None:
        return "the transfer function has no shading"
    return None if scene.shines else "the scene has no light"


def idle_because(scene: Scene) -> str | None:
    """Why an effect that belongs to shading is off, as words behind "off"; None where the scene is shaded."""
    reason = _unlit_because(scene)
    return reason if reason in (None, BAKED) else "nothing is shaded"


def _shade_of(scene: Scene) -> Shade | None:
    """How the transfer function shades; None if not, and for a .rle file without one."""
    return None if scene.transfer_function is None else scene.transfer_function.shade


def _with_shade(scene: Scene, **coefficients) -> Scene:
    shade = change(scene.transfer_function.shade, **coefficients)
    return change(scene, transfer_function=change(scene.transfer_function, shade=shade))


# --- shading: c * (ambient + diffuse |n.l|) in place of c -----------------------------------------------------------


def _shading(scene: Scene, _: Quality) -> tuple[bool, str]:
    reason = _unlit_because(scene)
    if reason is not None:
        return False, reason
    shade = scene.transfer_function.shade
    lit_by = [f"{len(scene.lights)} light(s) of the scene"] * bool(scene.lights) + ["a headlight"] * scene.headlight
    lit_by += ["the world"] * any(scene.world or ())
    return True, f"diffuse {shade.diffuse:g} and ambient {shade.ambient:g} under {' and '.join(lit_by)}"


def _remove_shade(scene: Scene) -> Scene:
    if _shade_of(scene) is None:
        return scene
    return change(scene, transfer_function=change(scene.transfer_function, shade=None))


def _force_shade(scene: Scene) -> Scene:
    tf = scene.transfer_function
    shaded = change(tf, shade=Shade()) if tf.shade is None else tf
    return change(scene, transfer_function=shaded, headlight=scene.headlight or not scene.shines)


# --- light sources ----------------------------------------------------------------------------------------------------


def _lights(scene: Scene, _: Quality) -> tuple[bool, str]:
    if not scene.lights:
        return False, "the scene has no lights" if scene.volume.holds_values else BAKED
    reason = idle_because(scene)
    kinds = Counter(light.type.lower() for light in scene.lights)
    return reason is None, reason or ", ".join(f"{number} {kind}" for kind, number in kinds.items())


def _headlight(scene: Scene, _: Quality) -> tuple[bool, str]:
    if not scene.headlight:
        return False, "the scene has no headlight" if scene.volume.holds_values else BAKED
    reason = idle_because(scene)
    return reason is None, reason or "white and parallel, along the camera's axis"


# --- highlights -----------------------------------------------------------------------------------------------------


def _specular(scene: Scene, _: Quality) -> tuple[bool, str]:
    reason = idle_because(scene)
    if reason is not None:
        return False, reason
    shade = scene.transfer_function.shade
    if shade.specular == 0.0:
        return False, "specular 0"
    return True, f"specular {shade.specular:g}, shininess {shade.shininess:g}"


def _without_specular(scene: Scene) -> Scene:
    return scene if _shade_of(scene) is None else _with_shade(scene, specular=0.0)


def _with_specular(scene: Scene) -> Scene:
    shade = _shade_of(scene)
    return _with_shade(scene, specular=Shade.specular) if shade is not None and shade.specular == 0.0 else scene


SHADING = Kind(
    "Shade surfaces by their angle to the light", _shading, _remove_shade, stage="shade", with_default=_force_shade,
)  # fmt: skip
LIGHTS = Kind(
    "Light the volume by the lights of the scene", _lights,
    lambda scene: change(scene, lights=()),
)  # fmt: skip
HEADLIGHT = Kind(
    "Light the volume by one white parallel light along the camera's axis", _headlight,
    lambda scene: change(scene, headlight=False),
    with_default=lambda scene: change(scene, headlight=True),
)  # fmt: skip
SPECULAR = Kind(
    "Add highlights, which change with the view", _specular, _without_specular,
    with_default=_with_specular,
)  # fmt: skip
