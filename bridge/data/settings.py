"""The settings of a Blender scene as plain data."""

from ...rle_splat.scene import (
    DEFAULT_QUALITY,
    NO_RAYS,
    POST_ONLY,
    REMOVED_BACKEND,
    Quality,
    preintegrated_of,
    preset_knobs,
)
from . import preferences
from .decimals import typed

# Millimeters per unit.  A VDB states no unit; Blender takes its world units as meters.
MILLIMETERS = {"um": 0.001, "mm": 1.0, "cm": 10.0, "m": 1000.0, "world": 1000.0}
KNOBS = ("depth_rule", "kernel", "minification", "warp_filter", "model")
# Property -> number in files and keyframes of earlier versions -> the value that was removed, a key of
# rle_splat.scene.REMOVED_VALUES.  The number has no item now, which reads as "".
REMOVED_NUMBERS = {"classification": {1: "refined"}, "minification": {2: "pool"}, "record": {2: 6, 3: 4}}
# Property of scenes of earlier versions -> the end of the sentence that a user reads who sets it, or has set it.
REMOVED_PROPERTIES = {
    "use_previews": "was removed; pictures that take long show a draft first", "backend": REMOVED_BACKEND,
}  # fmt: skip
OF_PRE = ("record", "kernel", "minification", "model")  # knobs that have only one value with post-classification


def quality_of(scene) -> Quality:
    """The quality chosen in a scene.

    The classification counts with every quality but "paper".  The other knobs count only with "custom".

    Raises
    ------
    RleSplatError
        For a knob out of range, or one that the classification does not support.
    """
    settings = scene.rle_splat
    threads = settings.threads or preferences.value("threads")
    common = dict(threads=threads, record=saved_value(settings, "record"))
    if settings.quality == "paper":
        return Quality.paper(**common)
    common |= dict(classification=saved_value(settings, "classification"))
    if settings.quality == "custom":
        knobs = {name: saved_value(settings, name) for name in KNOBS}
        return Quality(
            name="custom", sheet_density=typed(settings.sheet_density), termination=typed(settings.termination),
            rays=typed(settings.rays) if settings.classification == "post" else NO_RAYS,
            axis_fade=typed(settings.axis_fade), **knobs, **common,
        )  # fmt: skip
    return Quality.preset(settings.quality, **common)


def saved_value(settings, name: str) -> str | int:
    """The value of a knob that is an enum, as Quality has it; one that was removed is the one that it was."""
    value = getattr(settings, name) or REMOVED_NUMBERS.get(name, {}).get(settings.get(name), "")
    return int(value) if name == "record" else value


def removed_sentence(name: str) -> str:
    """What a user reads on a property of REMOVED_PROPERTIES."""
    return f"The setting {name} {REMOVED_PROPERTIES[name]}."


def not_in_post(settings, name: str) -> bool:
    """Whether a knob of OF_PRE counts and has a value that post-classification does not support."""
    counts = name == "record" or settings.quality == "custom"
    return counts and getattr(settings, name) != str(POST_ONLY[name])


_suited: list = []  # settings that ``suit_knobs`` is changing, so that ``suit_classification`` ignores them


def suit_knobs(settings) -> None:
    """After a change of the classification: set knobs that it does not support to values that it supports."""
    if settings.classification == "post":
        _suited.append(settings)
        for name in OF_PRE:
            setattr(settings, name, str(POST_ONLY[name]))
        _suited.pop()
    elif preintegrated_of(settings.depth_rule) is not None:
        settings.depth_rule = preset_knobs(DEFAULT_QUALITY, settings.classification)["depth_rule"]


def suit_classification(settings) -> None:
    """After a change of a knob: choose the classification that supports its value."""
    if _suited:
        return
    if settings.classification == "post":
        if any(not_in_post(settings, name) for name in OF_PRE):
            settings.classification = "pre"
    elif settings.quality == "custom" and preintegrated_of(settings.depth_rule) is not None:
        settings.classification = "post"


def tolerance_of(scene) -> float | None:
    """The maximum error of a scene in levels of 1/255; None if it is 0, when the quality counts."""
    return typed(scene.rle_splat.max_error) or None


def is_pre_classified(settings) -> bool:
    """Whether pictures are pre-classified.  With a maximum error they then have no shadows, as their truth has none."""
    return settings.classification == "pre" or settings.quality == "paper"


def scene_scale_of(scene, unit: str = "mm") -> float:
    """World units per length unit of a volume; a unit that is not known counts as a millimeter."""
    return typed(scene.rle_splat.scene_scale) * MILLIMETERS.get(unit, 1.0)
