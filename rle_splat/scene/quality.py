"""Quality settings that trade time for accuracy, and presets of them."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, replace
from reprlib import repr as short
from typing import Any, Literal, get_args

import numpy as np

from .errors import RleSplatError

QualityName = Literal["draft", "standard", "fine", "strict"]
Classification = Literal["pre", "post"]
Kernel = Literal["nearest", "tent", "bspline2", "bspline3", "gaussian"]
Minification = Literal["off", "widen"]
WarpFilter = Literal["bilinear", "keys", "cubic"]
Model = Literal["extinction", "opacity"]
Record = Literal[16, 8]  # bytes of a voxel record in the run-length tables; see encode/records.py

NO_RAYS = 0.0
PRESET_KNOBS = ("depth_rule", "sheet_density", "warp_filter", "termination", "rays")
# What each quality preset sets of PRESET_KNOBS: for pre-classified sheets and for post-classified ones, for which this
# is the usual plan: pipeline/preset_plan.py takes a better one for scenes that need it.
# tests/truths/test_ladder.py asserts their errors; the benchmark "stages" prints their times.
QUALITY_PRESETS: dict[QualityName, dict[Classification, tuple]] = {
    "draft": {
        "pre": ("slice", 0.7, "bilinear", 1 / 256, NO_RAYS),
        "post": ("preintegrated", 0.45, "bilinear", 1 / 256, NO_RAYS),
    },
    "standard": {
        "pre": ("simpson", 1.0, "cubic", 1 / 1024, NO_RAYS),
        "post": ("preintegrated", 1.0, "cubic", 1 / 1024, NO_RAYS),
    },
    "fine": {
        "pre": ("simpson", 1.5, "cubic", 1 / 2048, NO_RAYS),
        "post": ("midpoint-3", 1.25, "cubic", 1 / 2048, 0.6),
    },
    "strict": {
        "pre": ("midpoint-4", 3.0, "cubic", 1 / 8192, NO_RAYS),
        "post": ("midpoint-4", 2.0, "cubic", 1 / 8192, 0.45),
    },
}
EXACT_LIGHT = ("strict",)  # presets whose shadows and ambient occlusion are traced
# The error that each preset aims at with post-classified sheets, with and without lamps: 999 of 1000 pixels err by at
# most so many levels (1/255 of full scale, of any channel of premultiplied scene-linear RGBA).
PRESET_AIMS = {"draft": 160.0, "standard": 80.0, "fine": 40.0, "strict": 25.0}
DEFAULT_QUALITY: QualityName = "standard"
# Values of the settings, in the order in which they are shown.
CLASSIFICATIONS = get_args(Classification)
DEFAULT_CLASSIFICATION: Classification = "post"
# What earlier versions had: field of Quality -> value that was removed -> the one that is used instead. The
# classification is the first, because the one that is used instead can change the others.
REMOVED_VALUES = {"classification": {"refined": "post"}, "minification": {"pool": "widen"}, "record": {6: 8, 4: 8}}
REMOVED_FIELDS = ("refinement", "backend")  # in files of earlier versions; they are left out without a word
# The end of a sentence on Blender's setting of this name.
REMOVED_BACKEND = "was removed; numba is used where it can be loaded, and numpy elsewhere"
# The only values that the classification "post" supports; "pre" offers others too.
POST_ONLY = {"kernel": "tent", "model": "extinction", "minification": "off", "length_correction": True, "record": 16}
MOST_MIDPOINTS = 64
MOST_SHEET_DENSITY = 16
MOST_PREINTEGRATED = 8
MOST_FADE = 15.0  # degrees; a wider range would draw most views along several axes
# slice-2 is every second slice. Lists of depth rules show only some of midpoint-M.
NAMED_DEPTH_RULES = ("slice", "slice-2", "simpson", "gauss2")
DEPTH_RULES = (*NAMED_DEPTH_RULES, *(f"midpoint-{m}" for m in (1, 2, 3, 4, 8, 16)))
SCALAR_DEPTH_RULES = ("preintegrated", "preintegrated-2", "preintegrated-4")  # post-classified sheets only
FOOTPRINTS = get_args(Kernel)
MINIFICATIONS = get_args(Minification)
WARP_FILTERS = get_args(WarpFilter)
MODELS = get_args(Model)
RECORDS = get_args(Record)
# Description of each setting, used as command-line help and as tooltip of the panel.
KNOB_TEXTS = {
    "classification": "when values become opacity and color: before or after interpolation",
    "depth_rule": "how opacity and color are integrated between slices along the view",
    "sheet_density": "sheet pixels per image pixel; 0 for one sheet pixel per voxel",
    "kernel": "reconstruction kernel, the footprint of a voxel; post supports tent only",
    "minification": "what prevents shimmer where several voxels share a sheet pixel: widen enlarges the footprints; "
    "post supports off only",
    "warp_filter": "filter that resamples the intermediate image to the picture",
    "axis_fade": "range in degrees around a change of the principal axis in which pictures along both axes are "
    "blended, so that nothing pops when the camera turns; orthographic cameras only",
    "termination": "transmittance below which a pixel counts as opaque",
    "rays": "difference between neighboring pixels (1 is black to white) from which a pixel gets its own ray, which is "
    "slower and exact; at most a quarter of large pictures, without limit up to 0.02; 0 for no rays; post only",
    "model": "what overlapping footprints add up; post supports extinction only",
    "record": "bytes of a voxel record in the run-length tables; 8 saves memory and loses accuracy, and renders by the "
    "classification pre",
}


# Which truth a picture's errors are against: the integral of the interpolated classified medium (T1), or of the
# classified interpolated scalar (T2).
TRUTHS = {"pre": "T1", "post": "T2"}


def truth_of(quality: Quality) -> str:
    """The name of the truth that a quality promises to come near to."""
    return TRUTHS[quality.classification]


def preintegrated_of(depth_rule: str) -> int | None:
    """Slabs per cell of the rule preintegrated (1) or preintegrated-M (M); None for any other name."""
    found = re.fullmatch("preintegrated(?:-([1-9]))?", str(depth_rule))
    slabs = int(found[1] or 1) if found else None
    return slabs if slabs is not None and slabs <= MOST_PREINTEGRATED else None


def preset_knobs(name: str, classification: str = DEFAULT_CLASSIFICATION) -> dict:
    """Values of PRESET_KNOBS that the quality preset ``name`` sets; RleSplatError if there is no such preset.

    Parameters
    ----------
    name : str
        A key of QUALITY_PRESETS.
    classification : str
        One of CLASSIFICATIONS.

    Returns
    -------
    dict
        Field of Quality -> value.
    """
    if name not in QUALITY_PRESETS:
        raise RleSplatError(f"There is no quality {name!r}; choose {', '.join(QUALITY_PRESETS)}.")
    rung = QUALITY_PRESETS[name]["pre" if classification == "pre" else "post"]
    return dict(zip(PRESET_KNOBS, rung, strict=True))


def traces_light(name: str, classification: str) -> bool:
    """Whether the quality preset ``name`` has ``exact_light``."""
    return name in EXACT_LIGHT and classification == "post"


def not_in_post(knobs: dict) -> list[str]:
    """Names of those ``knobs`` (field of Quality -> value) whose value post-classified sheets do not support."""
    return [knob for knob, only in POST_ONLY.items() if knobs.get(knob, only) != only]


def without_removed(knobs: dict) -> tuple[dict, tuple[str, ...]]:
    """Replace the values of REMOVED_VALUES, and leave out the fields of REMOVED_FIELDS.

    Parameters
    ----------
    knobs : dict
        Field of Quality -> value, as an earlier version wrote them.

    Returns
    -------
    dict
        The knobs as Quality has them now.
    tuple of str
        A sentence for the user for each value that was replaced.
    """
    knobs, sentences = dict(knobs), []
    for field, values in REMOVED_VALUES.items():
        removed = knobs.get(field)
        if removed not in tuple(values):
            continue
        knobs[field] = values[removed]
        used = repr(knobs[field])
        if field == "classification" and (others := not_in_post(knobs)):
            knobs |= {name: POST_ONLY[name] for name in others}
            used += " with " + " and ".join(f"the {name.replace('_', ' ')} {POST_ONLY[name]}" for name in others)
        sentences.append(f"The {field.replace('_', ' ')} {removed!r} was removed; {used} is used instead.")
    return {name: value for name, value in knobs.items() if name not in REMOVED_FIELDS}, tuple(sentences)


def midpoints_of(depth_rule: str) -> int | None:
    """Sheets per cell of the rule midpoint-M (M from 1 to MOST_MIDPOINTS); None for any other name."""
    found = re.fullmatch("midpoint-([1-9][0-9]?)", str(depth_rule))
    return int(found[1]) if found and int(found[1]) <= MOST_MIDPOINTS else None


@dataclass(frozen=True)
class Quality:
    """Settings that trade time for accuracy. Most programs need ``Quality.preset`` alone.

    The command line has options of the same names; names of Blender's panel are in italics. ``depth_rule``,
    ``sheet_density``, ``warp_filter``, ``termination``, ``rays`` and ``exact_light`` that are None take their value
    from the preset ``name``, or, where there is none of this name, from "standard".

    Single rays are limited to the 64 steepest pixels of each 16 x 16 pixels of the frame, so that a noisy picture,
    which is steep everywhere, does not trace a ray for every pixel. Frames of fewer than 512 x 512 pixels have a
    proportionally larger limit, up to 65536 rays.

    Parameters
    ----------
    classification : {"post", "pre"}
        *Interpolate*. "post" (post-classified, *Values*) interpolates values and classifies in every sheet pixel, as a
        ray caster does; kernel, minification, model, record and length_correction then have their defaults. "pre"
        (pre-classified, *Colors*) classifies voxels and interpolates the result, as the paper does. "post" shows the
        box spanned by the voxel centers; "pre" extends beyond it by the footprints of the outer voxels.
    depth_rule : str or None
        *Layers*. How opacity and color are integrated between slices: "slice", "slice-2" (every second slice),
        "simpson", "gauss2", "midpoint-M" with M from 1 to 64, or, with "post", "preintegrated" or "preintegrated-M"
        with M to 8.
    sheet_density : float or None
        *Pixel Density*. Sheet pixels per image pixel; 0 for one sheet pixel per voxel, as in the paper.
    kernel : str
        *Voxel Shape*. Reconstruction kernel of a voxel's footprint: "tent" (linear), "nearest", "bspline2", "bspline3"
        or "gaussian".
    minification : {"off", "widen"}
        *Small Voxels*. "widen" enlarges the footprints where several voxels share a sheet pixel, against shimmer. "off"
        shows exactly what lies on each pixel's ray.
    warp_filter : str or None
        *Pixel Filter*. Filter that resamples the intermediate image: "bilinear", "keys" or "cubic".
    termination : float or None
        *Stop Below*. Transmittance below which a pixel counts as opaque; 0 to 0.5.
    axis_fade : float
        *Blend Angle (°)*. Range in degrees, 0 to 15, around a change of the principal axis of parallel rays. Inside it,
        pictures along both axes are rendered and blended, so that nothing pops as the camera turns.
    rays : float or None
        *Exact Pixels*. A pixel gets a single ray of its own, without sheets and warp, where a channel of the
        premultiplied scene-linear picture differs by at least this much among its 3 x 3 neighbors; 0 for none. Of each
        16 x 16 pixels, at most 64 get one; up to 0.02, all in which something is seen. Only "post", and neither in mist
        nor with opacity by gradient.
    model : {"extinction", "opacity"}
        *Overlap*. What overlapping footprints add up.
    length_correction : bool
        Whether the opacity of a sheet depends on the obliquity of the ray. False is the paper's literal reading.
    record : {16, 8}
        *Voxel Memory*. Bytes of a voxel record in the run-length tables. Smaller records save memory and lose accuracy;
        only "pre" has them.
    threads : int
        Number of threads; 0 for one per core.
    name : str
        Name of the preset, or another one for reports; "strict" is *Very Fine*.
    exact_light : bool or None
        Whether what arrives of lights and of ambient light is traced by rays beside each voxel, not read from a grid:
        slower and more accurate. The preset "strict" has it, and plans for a tolerance. Only "post".
    held : bool
        Whether these settings are used as they are. Without it, those of a preset may be replaced by others in
        scenes with sharp edges. In an animation, it gives all frames the settings of the first.

    Raises
    ------
    RleSplatError
        If a value is out of range, or two settings exclude each other.
    """

    classification: Classification = DEFAULT_CLASSIFICATION
    depth_rule: str | None = None
    sheet_density: float | None = None
    kernel: Kernel = "tent"
    minification: Minification = "off"
    warp_filter: WarpFilter | None = None
    termination: float | None = None
    axis_fade: float = 2.0
    rays: float | None = None
    model: Model = "extinction"
    length_correction: bool = True
    record: Record = 16
    threads: int = 0
    name: str = DEFAULT_QUALITY
    exact_light: bool | None = None
    held: bool = False

    def __post_init__(self):
        knobs, sentences = without_removed(vars(self))
        for sentence in sentences:
            warnings.warn(sentence, FutureWarning, stacklevel=3)
            for knob, value in knobs.items():
                object.__setattr__(self, knob, value)
        preset = self.name if self.name in QUALITY_PRESETS else DEFAULT_QUALITY
        usual = preset_knobs(preset, self.classification) | {"exact_light": traces_light(preset, self.classification)}
        for knob, value in usual.items():
            if getattr(self, knob) is None:
                object.__setattr__(self, knob, value)
        for value, allowed, what in (
            (self.classification, CLASSIFICATIONS, "classification"),
            (self.kernel, FOOTPRINTS, "kernel"),
            (self.minification, MINIFICATIONS, "minification"),
            (self.warp_filter, WARP_FILTERS, "warp filter"),
            (self.model, MODELS, "model"),
        ):
            if value not in allowed:
                raise RleSplatError(f"There is no {what} called {value!r}; choose {' or '.join(allowed)}.")
        if preintegrated_of(self.depth_rule) is not None:
            if self.classification != "post":
                raise RleSplatError(
                    f"The depth rule {self.depth_rule} integrates the transfer function between sheets of scalar "
                    "values; choose the classification post with it, or another depth rule."
                )
        elif self.depth_rule not in NAMED_DEPTH_RULES and midpoints_of(self.depth_rule) is None:
            raise RleSplatError(
                f"There is no depth rule called {self.depth_rule!r}; choose {', '.join(NAMED_DEPTH_RULES)}, or "
                f"midpoint-M with a whole number M from 1 to {MOST_MIDPOINTS}; or, with the classification post, "
                f"preintegrated, or preintegrated-M with M up to {MOST_PREINTEGRATED}."
            )
        if self.classification == "post" and (missing := not_in_post(vars(self))):
            knob = missing[0]
            raise RleSplatError(
                f"The classification post supports the {knob.replace('_', ' ')} {POST_ONLY[knob]} only, not "
                f"{getattr(self, knob)}; choose that, or the classification pre."
            )
        if self.record not in RECORDS:
            raise RleSplatError(f"A voxel record has {', '.join(map(str, RECORDS))} bytes, not {self.record!r}.")
        if not (np.isfinite(self.sheet_density) and 0.0 <= self.sheet_density <= MOST_SHEET_DENSITY):
            raise RleSplatError(
                f"The sheet density must be from 0 to {MOST_SHEET_DENSITY} sheet pixels per image pixel, "
                f"not {self.sheet_density!r}."
            )
        if not (0.0 <= self.termination < 0.5):
            raise RleSplatError(f"The termination must be at least 0 and below 0.5, not {self.termination!r}.")
        if not (0.0 <= self.axis_fade <= MOST_FADE):
            raise RleSplatError(f"The axis fade must be from 0 to {MOST_FADE:g} degrees, not {self.axis_fade!r}.")
        if not (np.isfinite(self.rays) and self.rays >= 0.0):
            raise RleSplatError(f"The setting rays must be 0, for no rays, or a positive number, not {self.rays!r}.")
        if self.rays and self.classification != "post":
            raise RleSplatError(
                "Single rays need voxels that are not classified yet; choose the classification post with them, or set "
                "rays to 0."
            )
        if self.threads < 0:
            raise RleSplatError("The number of threads must not be negative; 0 means one per core.")

    @classmethod
    def preset(
        cls, name: QualityName, /, classification: Classification = DEFAULT_CLASSIFICATION, **overrides: Any
    ) -> Quality:
        """Make a Quality from the preset draft, standard, fine or strict.

        Parameters
        ----------
        name : {"draft", "standard", "fine", "strict"}
            From the fastest to the most accurate.
        classification : {"post", "pre"}
            As the field of this name.
        **overrides
            Fields of Quality that differ from the preset.

        Returns
        -------
        Quality
        """
        knobs: dict[str, Any] = {"name": name, "exact_light": traces_light(name, classification)}
        return cls(classification=classification, **{**knobs, **preset_knobs(name, classification), **overrides})

    @property
    def is_preset(self) -> bool:
        """Whether all that a preset sets is as the preset of this name has it."""
        if self.held or self.name not in QUALITY_PRESETS:
            return False
        mine = preset_knobs(self.name, self.classification)
        return all(getattr(self, knob) == value for knob, value in mine.items())

    def classified(self, classification: Classification) -> Quality:
        """Copy with another classification. If all settings are those of a preset, the copy has that preset's too."""
        knobs = {"classification": classification, "rays": NO_RAYS if classification == "pre" else self.rays}
        if self.is_preset:
            knobs |= preset_knobs(self.name, classification)
            knobs["exact_light"] = traces_light(self.name, classification)
        return replace(self, **knobs)

    @classmethod
    def paper(cls, **overrides: Any) -> Quality:
        """The paper's literal pipeline: opacities added in slice-plane sheets, one sheet pixel per voxel.

        ``overrides`` are fields of Quality that differ.
        """
        return cls(
            classification="pre", depth_rule="slice", sheet_density=0.0, warp_filter="bilinear", model="opacity",
            length_correction=False, axis_fade=0.0, name="paper", **overrides,
        )  # fmt: skip


def as_quality(quality: Quality | QualityName | None) -> Quality:
    """Check a quality, or take a preset by its name; None is "standard"."""
    if isinstance(quality, str):
        return Quality.preset(quality)
    if not (quality is None or isinstance(quality, Quality)):
        raise RleSplatError(f'The quality must be a Quality or the name of one, such as "fine", not {short(quality)}.')
    return quality or Quality()
