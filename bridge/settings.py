"""The settings of a Blender scene as the renderer's plain data."""

from ..rle_splat.scene import Quality
from .decimals import typed

# A VDB states no unit; Blender takes its world units as metres.
MILLIMETRES = {"um": 0.001, "mm": 1.0, "cm": 10.0, "m": 1000.0, "world": 1000.0}
KNOBS = ("classification", "depth_rule", "kernel", "minification", "warp_filter", "model")


def quality_of(scene) -> Quality:
    """The ``Quality`` chosen in ``scene.rle_splat``; knobs count only under "custom".

    Raises RleSplatError for a knob out of its range.
    """
    settings = scene.rle_splat
    common = dict(threads=settings.threads, backend=settings.backend, record=int(settings.record))
    if settings.quality == "paper":
        return Quality.paper(**common)
    if settings.quality == "custom":
        knobs = {name: getattr(settings, name) for name in KNOBS}
        return Quality(
            name="custom", sheet_density=typed(settings.sheet_density), termination=typed(settings.termination),
            refinement=int(settings.refinement), **knobs, **common,
        )
    return Quality.preset(settings.quality, **common)


def tolerance_of(scene) -> float | None:
    """The largest error that is allowed, in levels; None where the quality decides."""
    return typed(scene.rle_splat.max_error) or None


def scene_scale_of(scene, unit: str = "mm") -> float:
    """World units for each unit of a volume: the scene's factor for a millimetre times the unit's millimetres.

    ``unit``: a volume's own unit of length; one that is not known counts as a millimetre.
    """
    return typed(scene.rle_splat.scene_scale) * MILLIMETRES.get(unit, 1.0)
