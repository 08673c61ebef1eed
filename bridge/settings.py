"""The settings of a Blender scene as the renderer's plain data."""

from ..rle_splat.scene import DEFAULT_QUALITY, NO_RAYS, POST_ONLY, Quality, preintegrated_of, preset_knobs
from .decimals import typed

# A VDB states no unit; Blender takes its world units as meters.
MILLIMETERS = {"um": 0.001, "mm": 1.0, "cm": 10.0, "m": 1000.0, "world": 1000.0}
KNOBS = ("depth_rule", "kernel", "minification", "warp_filter", "model")
OF_PRE = ("record", "kernel", "minification", "model")  # what post has one value of


def quality_of(scene) -> Quality:
    """The ``Quality`` chosen in ``scene.rle_splat``: the classification goes with all but the paper's, the other knobs
    count only under "custom".

    Raises RleSplatError for a knob out of its range, or one that the classification does not have.
    """
    settings = scene.rle_splat
    common = dict(threads=settings.threads, backend=settings.backend, record=int(settings.record))
    if settings.quality == "paper":
        return Quality.paper(**common)
    common |= dict(classification=settings.classification, refinement=int(settings.refinement))
    if settings.quality == "custom":
        knobs = {name: getattr(settings, name) for name in KNOBS}
        return Quality(
            name="custom", sheet_density=typed(settings.sheet_density), termination=typed(settings.termination),
            rays=typed(settings.rays) if settings.classification == "post" else NO_RAYS,
            axis_fade=typed(settings.axis_fade), **knobs, **common,
        )
    return Quality.preset(settings.quality, **common)


def not_in_post(settings, name: str) -> bool:
    """Whether a knob of OF_PRE counts, and has a value that the classification post does not have."""
    counts = name == "record" or settings.quality == "custom"
    return counts and getattr(settings, name) != str(POST_ONLY[name])


_suited: list = []  # settings whose knobs are being changed one after the other, which choose nothing meanwhile


def suit_knobs(settings) -> None:
    """After the classification was chosen: knobs that it does not have as they are take a value that it has."""
    if settings.classification == "post":
        _suited.append(settings)
        for name in OF_PRE:
            setattr(settings, name, str(POST_ONLY[name]))
        _suited.pop()
    elif preintegrated_of(settings.depth_rule) is not None:
        settings.depth_rule = preset_knobs(DEFAULT_QUALITY, settings.classification)["depth_rule"]


def suit_classification(settings) -> None:
    """After a knob was chosen: one that only another classification has, means that one."""
    if _suited:
        return
    if settings.classification == "post":
        if any(not_in_post(settings, name) for name in OF_PRE):
            settings.classification = "pre"
    elif settings.quality == "custom" and preintegrated_of(settings.depth_rule) is not None:
        settings.classification = "post"


def tolerance_of(scene) -> float | None:
    """The largest error that is allowed, in levels; None where the quality decides."""
    return typed(scene.rle_splat.max_error) or None


def scene_scale_of(scene, unit: str = "mm") -> float:
    """World units for each unit of a volume: the scene's factor for a millimeter times the unit's millimeters.

    ``unit``: a volume's own unit of length; one that is not known counts as a millimeter.
    """
    return typed(scene.rle_splat.scene_scale) * MILLIMETERS.get(unit, 1.0)
