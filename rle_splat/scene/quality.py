"""The knobs that trade time for accuracy, and the presets of them."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from .errors import RleSplatError

NO_RAYS = 0.0
PRESET_KNOBS = ("depth_rule", "sheet_density", "warp_filter", "termination", "rays")
# One table of names for the command line, the panel and the reports: what each quality preset sets of PRESET_KNOBS,
# for sheets of classified voxels, pre and refined, and for post-classified ones.
# Their errors against the truths are asserted in tests/truths/test_ladder.py, their times printed by bench stages.
QUALITY_PRESETS = {
    "draft": {
        "pre": ("slice", 0.7, "bilinear", 1 / 256, NO_RAYS), "post": ("slice-2", 0.4, "bilinear", 1 / 256, NO_RAYS),
    },
    "standard": {
        "pre": ("simpson", 1.0, "cubic", 1 / 1024, NO_RAYS),
        "post": ("preintegrated", 1.0, "cubic", 1 / 1024, NO_RAYS),
    },
    "fine": {
        "pre": ("simpson", 1.5, "cubic", 1 / 2048, NO_RAYS), "post": ("gauss2", 1.25, "cubic", 1 / 2048, 0.6),
    },
    "strict": {
        "pre": ("midpoint-4", 3.0, "cubic", 1 / 8192, NO_RAYS), "post": ("midpoint-4", 2.0, "cubic", 1 / 8192, 0.45),
    },
}
DEFAULT_QUALITY = "standard"
# Names of the knobs' values, in the order shown to people.
CLASSIFICATIONS = ("pre", "refined", "post")
DEFAULT_CLASSIFICATION = "post"
# The only values of these knobs that post has; pre and refined offer others too.
POST_ONLY = {"kernel": "tent", "model": "extinction", "minification": "off", "length_correction": True, "record": 16}
REFINEMENTS = (2, 3, 4)  # cells of the refined grid along each side of a voxel cell
MOST_MIDPOINTS = 64
MOST_SHEET_DENSITY = 16
MOST_PREINTEGRATED = 8
MOST_FADE = 15.0  # degrees; with more, most views would be drawn along several axes
# slice-2 is every second slice.  There is midpoint-M too, of which lists show some.
NAMED_DEPTH_RULES = ("slice", "slice-2", "simpson", "gauss2")
DEPTH_RULES = (*NAMED_DEPTH_RULES, *(f"midpoint-{m}" for m in (1, 2, 4, 8, 16)))
SCALAR_DEPTH_RULES = ("preintegrated", "preintegrated-2", "preintegrated-4")  # of sheets of the scalar alone
FOOTPRINTS = ("nearest", "tent", "bspline2", "bspline3", "gaussian")
MINIFICATIONS = ("off", "widen", "pool")
WARP_FILTERS = ("bilinear", "keys", "cubic")
MODELS = ("extinction", "opacity")
RECORDS = (16, 8, 6, 4)  # bytes of a voxel in the run-length tables; what each holds: encode/records.py
BACKENDS = ("auto", "numba", "numpy")
# What each knob is, for the help of the command line and the tooltips of the panel.
KNOB_TEXTS = {
    "classification": "when values become opacity and colour",
    "refinement": "how many times finer the grid is on which refined classifies",
    "depth_rule": "how sheets are integrated along the view",
    "sheet_density": "sheet pixels per image pixel; zero for one per voxel",
    "kernel": "footprint of a voxel: its reconstruction kernel; post has tent alone",
    "minification": "where several voxels share a sheet pixel, against shimmer: widen footprints, or pool voxels, "
    "quicker too; post does neither and shows what is there",
    "warp_filter": "filter from the intermediate image to the picture",
    "axis_fade": "degrees about the switch of the principal axis in which both are drawn and mixed, against popping; "
    "orthographic views alone",
    "termination": "transmittance below which a pixel counts as opaque",
    "rays": "how far apart a pixel and its neighbours must be, 1 between black and white, for a ray of its own, which "
    "is dearer and exact, of 512 x 512 pixels for a quarter at most; zero for none; post alone",
    "model": "what overlapping footprints add up; post has extinction alone",
    "record": "bytes of a classified voxel in the run-length tables; fewer save memory and lose accuracy",
    "backend": "what runs the loops",
}


# Which truth a picture's errors are against: the integral of the interpolated classified medium (T1), or of the
# classified interpolated scalar (T2).
TRUTHS = {"pre": "T1", "refined": "T2", "post": "T2"}


def truth_of(quality: Quality) -> str:
    """The name of the truth that a quality promises to come near to."""
    return TRUTHS[quality.classification]


def preintegrated_of(depth_rule: str) -> int | None:
    """How many slabs a cell has under the rule preintegrated (one) or preintegrated-M; None for any other name."""
    found = re.fullmatch("preintegrated(?:-([1-9]))?", str(depth_rule))
    slabs = int(found[1] or 1) if found else None
    return slabs if slabs is not None and slabs <= MOST_PREINTEGRATED else None


def preset_knobs(name: str, classification: str = DEFAULT_CLASSIFICATION) -> dict:
    """The knobs that the quality preset ``name`` sets, by field of Quality."""
    if name not in QUALITY_PRESETS:
        raise RleSplatError(f"There is no quality {name!r}; choose {', '.join(QUALITY_PRESETS)}.")
    rung = QUALITY_PRESETS[name]["post" if classification == "post" else "pre"]
    return dict(zip(PRESET_KNOBS, rung, strict=True))


def not_in_post(knobs: dict) -> list[str]:
    """Which of ``knobs``, values by field of Quality, post-classified sheets do not have."""
    return [knob for knob, only in POST_ONLY.items() if knobs.get(knob, only) != only]


def midpoints_of(depth_rule: str) -> int | None:
    """How many sheets a cell has under the rule midpoint-M, M from 1 to MOST_MIDPOINTS; None for any other name."""
    found = re.fullmatch("midpoint-([1-9][0-9]?)", str(depth_rule))
    return int(found[1]) if found and int(found[1]) <= MOST_MIDPOINTS else None


@dataclass(frozen=True)
class Quality:
    """The knobs that trade time for accuracy, each by the name the command line and the panel use.

    ``classification`` "post": the values are interpolated, and what is shown is classified in every sheet pixel, as in
    a ray caster; it has the knobs of POST_ONLY at those values alone.  "pre" is the paper's: voxels are classified, and
    what is shown is interpolated; "refined" interpolates the values on a grid ``refinement`` times finer first, against
    blurred edges.  All but "pre" show the box of the voxels' centres and nothing outside it.
    ``depth_rule``, ``sheet_density``, ``warp_filter``, ``termination`` and ``rays`` that are left out, or None, are
    those of the quality "standard" of the classification.
    ``kernel`` is the footprint; ``minification`` "widen" widens it where several voxels share a sheet pixel, for
    pictures without shimmer, "pool" averages voxels first, as many as fit into a sheet pixel everywhere in the picture,
    and widens what is left; "off" shows exactly what lies on each pixel's ray.
    ``sheet_density`` is sheet pixels per image pixel; 0 means one sheet pixel per voxel, as in the paper.
    ``record`` is how many bytes a voxel of the run-length tables takes: fewer save memory and lose accuracy.
    ``axis_fade``: within so many degrees of where the principal axis of parallel rays switches, pictures along both are
    mixed, so that nothing pops as the camera turns; they cost as many pictures.  0 to 15.
    ``rays``, above zero: pixels among whose 3 x 3 neighbours a channel of the premultiplied scene-linear picture takes
    values at least so far apart are had by single rays, without sheets and warp ("post" alone, and where nothing is in
    the scene that such rays do not know: ``single_rays.can_trace``).  Of each 16 x 16 pixels of the frame they are the
    64 steepest at most, so that noise, which is steep all over, does not take a ray for every pixel; in frames of fewer
    than 512 x 512 pixels as many more as make 65536 in all (``warp.steep``).
    ``termination`` is the transmittance at which a pixel counts as opaque.  ``length_correction`` off is the
    paper's literal reading: a sheet has the same opacity whatever the obliquity of the ray.
    """

    classification: str = DEFAULT_CLASSIFICATION
    refinement: int = 2
    depth_rule: str | None = None
    sheet_density: float | None = None
    kernel: str = "tent"
    minification: str = "off"
    warp_filter: str | None = None
    termination: float | None = None
    axis_fade: float = 2.0
    rays: float | None = None
    model: str = "extinction"
    length_correction: bool = True
    record: int = 16
    threads: int = 0
    backend: str = "auto"
    name: str = DEFAULT_QUALITY

    def __post_init__(self):
        for knob, value in preset_knobs(DEFAULT_QUALITY, self.classification).items():
            if getattr(self, knob) is None:
                object.__setattr__(self, knob, value)
        for value, allowed, what in (
            (self.classification, CLASSIFICATIONS, "classification"),
            (self.kernel, FOOTPRINTS, "kernel"),
            (self.minification, MINIFICATIONS, "minification"),
            (self.warp_filter, WARP_FILTERS, "warp filter"),
            (self.model, MODELS, "model"),
            (self.backend, BACKENDS, "backend"),
        ):
            if value not in allowed:
                raise RleSplatError(f"There is no {what} called {value!r}; choose {' or '.join(allowed)}.")
        if preintegrated_of(self.depth_rule) is not None:
            if self.classification != "post":
                raise RleSplatError(
                    f"The depth rule {self.depth_rule} integrates the transfer function between sheets of the scalar; "
                    "choose the classification post with it, or another depth rule."
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
                f"The classification post splats with the {knob.replace('_', ' ')} {POST_ONLY[knob]} only, not "
                f"{getattr(self, knob)}; choose that, or the classification pre."
            )
        if self.minification == "pool" and (self.classification != "pre" or self.model != "extinction"):
            raise RleSplatError(
                "The minification pool averages the extinction of classified voxels: choose the classification pre and "
                "the model extinction with it, or the minification widen."
            )
        if self.refinement not in REFINEMENTS:
            allowed = ", ".join(map(str, REFINEMENTS))
            raise RleSplatError(f"The refined grid is {allowed} times finer than the voxels, not {self.refinement!r}.")
        if self.record not in RECORDS:
            raise RleSplatError(f"A voxel's record has {', '.join(map(str, RECORDS))} bytes, not {self.record!r}.")
        if not (np.isfinite(self.sheet_density) and 0.0 <= self.sheet_density <= MOST_SHEET_DENSITY):
            raise RleSplatError(
                f"The sheet density must be between 0 and {MOST_SHEET_DENSITY} sheet pixels per image pixel."
            )
        if not (0.0 <= self.termination < 0.5):
            raise RleSplatError("The termination transmittance must be at least 0 and below 0.5.")
        if not (0.0 <= self.axis_fade <= MOST_FADE):
            raise RleSplatError(f"Principal axes fade into each other over 0 to {MOST_FADE:g} degrees.")
        if not (np.isfinite(self.rays) and self.rays >= 0.0):
            raise RleSplatError("How steep a pixel must be for a ray of its own is 0, for none, or a number above it.")
        if self.rays and self.classification != "post":
            raise RleSplatError(
                "Single rays go through voxels that are not classified yet; choose the classification post with them, "
                "or rays of 0, for none."
            )
        if self.threads < 0:
            raise RleSplatError("The number of threads must not be negative; 0 means one per core.")

    @classmethod
    def preset(cls, name: str, /, classification: str = DEFAULT_CLASSIFICATION, **overrides) -> Quality:
        """The quality preset ``name`` for a classification, some knobs overridden."""
        return cls(classification=classification, **{"name": name, **preset_knobs(name, classification), **overrides})

    def classified(self, classification: str) -> Quality:
        """The same for another classification; a preset stays that preset, whose knobs may be others."""
        knobs = {"classification": classification, "rays": self.rays if classification == "post" else NO_RAYS}
        if self.name in QUALITY_PRESETS:
            mine = preset_knobs(self.name, self.classification)
            if all(getattr(self, knob) == value for knob, value in mine.items()):
                knobs |= preset_knobs(self.name, classification)
        return replace(self, **knobs)

    @classmethod
    def paper(cls, **overrides) -> Quality:
        """The paper's literal pipeline: opacities added in slice-plane sheets, one sheet pixel per voxel."""
        return cls(
            classification="pre", depth_rule="slice", sheet_density=0.0, warp_filter="bilinear", model="opacity",
            length_correction=False, axis_fade=0.0, name="paper", **overrides,
        )
