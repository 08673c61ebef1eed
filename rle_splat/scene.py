"""Plain data that walks the whole road: what is seen, from where, how well, and what came out.

Nothing here computes a picture and nothing here knows Blender.  Every class is frozen; arrays inside are
treated as read-only.  Matrices are 4x4 float64, column vectors, applied as ``matrix @ (x, y, z, 1)``.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from reprlib import repr as short

import numpy as np

CAMERA_TYPES = ("PERSP", "ORTHO")
SENSOR_FITS = ("AUTO", "HORIZONTAL", "VERTICAL")
LIGHT_TYPES = ("SUN", "POINT", "SPOT", "AREA")
CLIP_KINDS = ("plane", "box")
CLIP_SIDES = ("inside", "outside")
# What a pixel shows of its ray: see ray_modes.py.
MODE_TEXTS = {
    "composite": "emission and absorption, front to back",
    "xray": "absorption alone, bone bright",
    "mip": "the largest value, as the transfer function shows it",
    "minip": "the smallest value",
    "average": "the mean value",
}
MODES = tuple(MODE_TEXTS)


class RleSplatError(Exception):
    """One sentence for the user: what is wrong and what to do.  Shown as it is, never as a traceback."""


class Cancelled(Exception):
    """The user stopped a long job; nothing half-made is left behind."""


# Entries of matrices: cubes of what is larger, as determinants are made of, would leave the range of float64.
LARGEST_ENTRY = 1e100


# Lengths of a camera, in whatever unit, and shares of the picture: far beyond any that is meant.
LEAST_LENGTH, LARGEST_LENGTH = 1e-50, 1e50
LARGEST_SHARE = 1e6
MOST_BLADES = 64


def as_float(value) -> float:
    """A number as float64; infinite when it is too large for one, NaN when it is no number at all."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
    except (TypeError, ValueError):
        return math.nan


def _is_finite_number(value) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(as_float(value))


def as_matrix(value, name: str) -> np.ndarray:
    """A finite 4x4 float64 affine matrix from nested lists or an array, or a RleSplatError that names it."""
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.empty(0)
    if matrix.shape != (4, 4):
        raise RleSplatError(f"{name} must be a 4x4 matrix of numbers, given as four rows of four.")
    if not np.isfinite(matrix).all():
        raise RleSplatError(f"{name} holds a value that is not finite; give sixteen ordinary numbers.")
    if np.abs(matrix).max() > LARGEST_ENTRY:
        raise RleSplatError(f"{name} holds a value beyond {LARGEST_ENTRY:g}; give sixteen ordinary numbers.")
    if not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0)):
        raise RleSplatError(f"{name} must be affine: its last row has to be 0 0 0 1.")
    matrix.setflags(write=False)
    return matrix


def _identity() -> np.ndarray:
    return as_matrix(np.eye(4), "the identity")


def from_mapping(cls, mapping, what: str):
    """An instance of the frozen dataclass ``cls`` from a JSON object, refusing names it does not have."""
    if not isinstance(mapping, dict):
        raise RleSplatError(f"{what} must be a JSON object with named values.")
    known = {f.name for f in fields(cls)}
    unknown = sorted(set(mapping) - known)
    if unknown:
        raise RleSplatError(f"{what} has no setting called {unknown[0]!r}; it knows {', '.join(sorted(known))}.")
    try:
        return cls(**mapping)
    except TypeError as problem:
        raise RleSplatError(f"{what} is incomplete or of the wrong kind: {problem}.") from None


def read_json(path, what: str):
    """The parsed JSON file at ``path``; a RleSplatError that names the file when it is missing or malformed."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as problem:
        raise RleSplatError(f"Cannot read {what} {path}: {problem.strerror or problem}; check the path.") from None
    except RecursionError:
        raise RleSplatError(f"{what} {path} is not valid JSON: it is nested without end; mend it there.") from None
    except ValueError as problem:
        raise RleSplatError(f"{what} {path} is not valid JSON: {problem}; mend it there.") from None


def _positive(value, name: str, least: float = LEAST_LENGTH, largest: float = LARGEST_LENGTH) -> float:
    number = as_float(value)
    if not (math.isfinite(number) and number > 0.0):
        raise RleSplatError(f"{name} must be a finite number above zero, not {short(value)}.")
    if not least <= number <= largest:
        raise RleSplatError(f"{name} must be from {least:g} to {largest:g}, not {short(value)}.")
    return number


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with Blender's own parameters and meaning.

    ``matrix_world`` takes camera space to the world; the camera looks along its -Z with +Y up, and scale in
    the matrix is ignored as Blender ignores it.  ``lens`` and the sensor are in mm, ``ortho_scale`` and the
    clip distances in world units, ``shift_x`` and ``shift_y`` in fractions of the larger image side.
    ``aperture_radius``, world units, is that of the lens, 0 for none; what lies at ``focus_distance``, planar and in
    world units, is sharp.  ``aperture_blades``, ``aperture_rotation`` (radians) and ``aperture_ratio`` shape its blur.
    """

    matrix_world: np.ndarray = field(default_factory=_identity)
    type: str = "PERSP"
    lens: float = 50.0
    sensor_width: float = 36.0
    sensor_height: float = 24.0
    sensor_fit: str = "AUTO"
    ortho_scale: float = 6.0
    shift_x: float = 0.0
    shift_y: float = 0.0
    clip_start: float = 0.1
    clip_end: float = 1000.0
    pixel_aspect: tuple = (1.0, 1.0)
    aperture_radius: float = 0.0
    focus_distance: float = 10.0
    aperture_blades: int = 0
    aperture_rotation: float = 0.0
    aperture_ratio: float = 1.0

    def __post_init__(self):
        put = partial(object.__setattr__, self)
        put("matrix_world", as_matrix(self.matrix_world, "The camera's matrix_world"))
        axes = self.matrix_world[:3, :3]
        # Scale is ignored, so what counts is whether the axes span space: the volume of their directions.
        if abs(np.linalg.det(axes)) <= 1e-9 * np.prod(np.linalg.norm(axes, axis=0)):
            raise RleSplatError("The camera's matrix_world is singular; give it a scale other than zero on every axis.")
        if self.type not in CAMERA_TYPES:
            raise RleSplatError(
                f"A camera of type {short(self.type)} cannot be splatted; use a perspective or an orthographic camera."
            )
        if self.sensor_fit not in SENSOR_FITS:
            raise RleSplatError(f"The camera's sensor_fit must be one of {', '.join(SENSOR_FITS)}.")
        for name in ("lens", "sensor_width", "sensor_height", "ortho_scale", "clip_start", "clip_end"):
            put(name, _positive(getattr(self, name), f"The camera's {name}"))
        for name in ("shift_x", "shift_y"):
            value = getattr(self, name)
            if not (_is_finite_number(value) and abs(value) <= LARGEST_SHARE):
                raise RleSplatError(f"The camera's {name} must be a finite number within {LARGEST_SHARE:g} of zero.")
            put(name, float(value))
        if self.clip_end <= self.clip_start:
            raise RleSplatError("The camera's clip_end must be larger than its clip_start.")
        for name in ("focus_distance", "aperture_ratio"):
            put(name, _positive(getattr(self, name), f"The camera's {name}"))
        for name, least in (("aperture_radius", 0.0), ("aperture_rotation", -LARGEST_SHARE)):
            value = getattr(self, name)
            if not (_is_finite_number(value) and least <= value <= LARGEST_SHARE):
                raise RleSplatError(f"The camera's {name} must be a number from {least:g} to {LARGEST_SHARE:g}.")
            put(name, float(value))
        if not isinstance(self.aperture_blades, (int, np.integer)) or not 0 <= self.aperture_blades <= MOST_BLADES:
            raise RleSplatError(f"The camera's aperture_blades must be a whole number from 0 to {MOST_BLADES}.")
        aspect = tuple(self.pixel_aspect) if np.iterable(self.pixel_aspect) else ()
        if len(aspect) != 2:
            raise RleSplatError("The camera's pixel_aspect must be two numbers.")
        limits = 1.0 / LARGEST_SHARE, LARGEST_SHARE
        put("pixel_aspect", tuple(_positive(a, "The camera's pixel_aspect", *limits) for a in aspect))

    @classmethod
    def from_json(cls, path) -> Camera:
        return from_mapping(cls, read_json(path, "the camera file"), "The camera file")


@dataclass(frozen=True, eq=False)
class Light:
    """A light with Blender's own parameters: it shines along the -Z of ``matrix_world``.

    ``energy`` is W/m^2 for a SUN and W for the others; lengths are world units, angles radians.
    """

    type: str = "SUN"
    color: tuple = (1.0, 1.0, 1.0)
    energy: float = 1.0
    matrix_world: np.ndarray = field(default_factory=_identity)
    radius: float = 0.0
    angle: float = 0.0
    size: float = 1.0
    size_y: float = 1.0
    shape: str = "SQUARE"
    spot_size: float = 0.785398
    spot_blend: float = 0.15
    casts_shadow: bool = True

    def __post_init__(self):
        object.__setattr__(self, "matrix_world", as_matrix(self.matrix_world, "A light's matrix_world"))
        if self.type not in LIGHT_TYPES:
            raise RleSplatError(f"A light's type must be one of {', '.join(LIGHT_TYPES)}, not {short(self.type)}.")
        color = tuple(as_float(c) for c in self.color) if np.iterable(self.color) else ()
        if len(color) != 3 or not np.isfinite(color).all() or min(color) < 0.0:
            raise RleSplatError("A light's color must be three finite numbers, none below zero.")
        object.__setattr__(self, "color", color)
        for name in ("energy", "radius", "angle", "size", "size_y", "spot_size", "spot_blend"):
            value = getattr(self, name)
            if not (_is_finite_number(value) and value >= 0.0):
                raise RleSplatError(f"A light's {name} must be a finite number, not below zero.")
            object.__setattr__(self, name, float(value))

    @classmethod
    def list_from_json(cls, path) -> tuple:
        entries = read_json(path, "the lights file")
        if not isinstance(entries, list):
            raise RleSplatError(f"The lights file {path} must hold a list of lights.")
        return tuple(from_mapping(cls, entry, "A light of the lights file") for entry in entries)


@dataclass(frozen=True, eq=False)
class Pose:
    """Where the camera and the volume are at one time: their matrices to the world, (4, 4)."""

    camera_matrix: np.ndarray
    volume_matrix: np.ndarray

    def __post_init__(self):
        for name in ("camera_matrix", "volume_matrix"):
            object.__setattr__(self, name, as_matrix(getattr(self, name), f"A pose's {name}"))


# The volume that the directions of a clip object's axes span, below which it is flat.
FLATTEST_CLIP = 1e-9


@dataclass(frozen=True, eq=False)
class Clip:
    """A plane or a box that cuts the volume.

    ``matrix_world`` takes its own space to the world.  A box is the cube from -1 to 1 of its own space.  A plane is
    z = 0 there, and its +Z points out of what is inside, as the normals of a mesh do: what an arrow points at is cut
    away.  ``keep``: which side stays, "inside" or "outside".
    """

    kind: str = "box"
    matrix_world: np.ndarray = field(default_factory=_identity)
    keep: str = "inside"

    def __post_init__(self):
        if self.kind not in CLIP_KINDS:
            raise RleSplatError(f"A clip object's kind must be {' or '.join(CLIP_KINDS)}, not {short(self.kind)}.")
        if self.keep not in CLIP_SIDES:
            raise RleSplatError(f"A clip object's keep must be {' or '.join(CLIP_SIDES)}, not {short(self.keep)}.")
        object.__setattr__(self, "matrix_world", as_matrix(self.matrix_world, "A clip object's matrix_world"))
        axes = self.matrix_world[:3, :3]
        lengths = np.linalg.norm(axes, axis=0)
        if not (lengths > 0.0).all() or abs(np.linalg.det(axes / lengths)) <= FLATTEST_CLIP:
            raise RleSplatError(
                f"A clip {self.kind}'s matrix_world is flat; give it a scale other than zero on every axis."
            )

    @classmethod
    def list_from_json(cls, path) -> tuple:
        entries = read_json(path, "the clip file")
        if not isinstance(entries, list):
            raise RleSplatError(f"The clip file {path} must hold a list of planes and boxes.")
        return tuple(from_mapping(cls, entry, "A plane or box of the clip file") for entry in entries)


@dataclass(frozen=True, eq=False)
class Labels:
    """What each voxel of a volume belongs to.

    ``volume``: a Volume of whole numbers, the labels, on the same grid.  ``functions``: label -> its TransferFunction,
    or None where what has the label is hidden; other labels have the scene's own.  ``names``: label -> text, for
    people.
    """

    volume: object
    functions: dict = field(default_factory=dict)
    names: dict = field(default_factory=dict)

    def __post_init__(self):
        if self.volume.voxels.dtype.kind not in "iu":
            raise RleSplatError(
                f"Labels must be whole numbers, not {self.volume.voxels.dtype.name}; give the volume of the labels."
            )
        for label in (*self.functions, *self.names):
            if isinstance(label, bool) or not isinstance(label, (int, np.integer)):
                raise RleSplatError(f"A label must be a whole number, not {short(label)}.")


@dataclass(frozen=True, eq=False)
class Channel:
    """A further volume on the same grid, and the transfer function that it is added by."""

    volume: object
    transfer_function: object


MIST_FALLOFFS = ("QUADRATIC", "LINEAR", "INVERSE_QUADRATIC")


@dataclass(frozen=True)
class Mist:
    """The mist of Blender's world: colour fades to ``color``, scene-linear RGB, none of it up to ``start`` from the
    camera, all of it ``depth`` further, world units; in between by ``falloff``, of Blender's meaning.

    The distance is the ray's own in perspective, along the camera's axis if it is orthographic, as in Cycles' pass.
    """

    start: float = 5.0
    depth: float = 25.0
    falloff: str = "QUADRATIC"
    color: tuple = (0.05, 0.05, 0.05)

    def __post_init__(self):
        if not (_is_finite_number(self.start) and 0.0 <= self.start <= LARGEST_LENGTH):
            raise RleSplatError(f"The mist's start must be a finite number, not below zero, not {short(self.start)}.")
        object.__setattr__(self, "start", float(self.start))
        object.__setattr__(self, "depth", _positive(self.depth, "The mist's depth"))
        if self.falloff not in MIST_FALLOFFS:
            raise RleSplatError(f"The mist's falloff must be one of {', '.join(MIST_FALLOFFS)}.")
        color = tuple(as_float(c) for c in self.color) if np.iterable(self.color) else ()
        if len(color) != 3 or not np.isfinite(color).all() or min(color) < 0.0:
            raise RleSplatError("The mist's color must be three finite numbers, none below zero.")
        object.__setattr__(self, "color", color)

    @classmethod
    def from_json(cls, path) -> Mist:
        return from_mapping(cls, read_json(path, "the mist file"), "The mist file")


PRESET_KNOBS = ("depth_rule", "sheet_density", "warp_filter", "termination")
# One table of names for the command line, the panel and the reports: what each quality preset sets of PRESET_KNOBS,
# for sheets of classified voxels, pre and refined, and for post-classified ones.
# Their errors against the truths are asserted in tests/truths/test_ladder.py, their times printed by bench stages.
QUALITY_PRESETS = {
    "draft": {"pre": ("slice", 0.7, "bilinear", 1 / 256), "post": ("slice-2", 0.4, "bilinear", 1 / 256)},
    "standard": {"pre": ("simpson", 1.0, "cubic", 1 / 1024), "post": ("preintegrated", 1.0, "cubic", 1 / 1024)},
    "fine": {"pre": ("simpson", 1.5, "cubic", 1 / 2048), "post": ("simpson", 1.25, "cubic", 1 / 2048)},
    "strict": {"pre": ("midpoint-4", 3.0, "cubic", 1 / 8192), "post": ("midpoint-4", 2.0, "cubic", 1 / 8192)},
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
# slice-2 is every second slice.  There is midpoint-M too, of which lists show some.
NAMED_DEPTH_RULES = ("slice", "slice-2", "simpson", "gauss2")
DEPTH_RULES = (*NAMED_DEPTH_RULES, *(f"midpoint-{m}" for m in (1, 2, 4, 8, 16)))
SCALAR_DEPTH_RULES = ("preintegrated", "preintegrated-2", "preintegrated-4")  # of sheets of the scalar alone
FOOTPRINTS = ("nearest", "tent", "bspline2", "bspline3", "gaussian")
MINIFICATIONS = ("off", "widen")
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
    "minification": "widen footprints where several voxels share a sheet pixel, against shimmer, which post does not; "
    "or show what is there",
    "warp_filter": "filter from the intermediate image to the picture",
    "termination": "transmittance below which a pixel counts as opaque",
    "model": "what overlapping footprints add up; post has extinction alone",
    "record": "bytes of a classified voxel in the run-length tables; fewer save memory and lose accuracy",
    "backend": "what runs the loops",
}


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
    ``depth_rule``, ``sheet_density``, ``warp_filter`` and ``termination`` that are left out, or None, are those of the
    quality "standard" of the classification.
    ``kernel`` is the footprint; ``minification`` "widen" widens it where several voxels share a sheet pixel, for
    pictures without shimmer, "off" shows exactly what lies on each pixel's ray.
    ``sheet_density`` is sheet pixels per image pixel; 0 means one sheet pixel per voxel, as in the paper.
    ``record`` is how many bytes a voxel of the run-length tables takes: fewer save memory and lose accuracy.
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
        if self.threads < 0:
            raise RleSplatError("The number of threads must not be negative; 0 means one per core.")

    @classmethod
    def preset(cls, name: str, /, classification: str = DEFAULT_CLASSIFICATION, **overrides) -> Quality:
        """The quality preset ``name`` for a classification, some knobs overridden."""
        return cls(classification=classification, **{"name": name, **preset_knobs(name, classification), **overrides})

    def classified(self, classification: str) -> Quality:
        """The same for another classification; a preset stays that preset, whose knobs may be others."""
        knobs = {"classification": classification}
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
            length_correction=False, name="paper", **overrides,
        )


def checked_crop(crop, width: int, height: int) -> tuple[int, int, int, int]:
    """(left, top, right, bottom) of a crop of a frame, or a RleSplatError when it is none."""
    sides = tuple(crop) if np.iterable(crop) else ()
    whole = len(sides) == 4 and all(isinstance(side, (int, np.integer)) for side in sides)
    if not (whole and 0 <= sides[0] < sides[2] <= width and 0 <= sides[1] < sides[3] <= height):
        raise RleSplatError(
            f"A crop must be four whole numbers of pixels, left, top, right and bottom, with left < right within 0 to "
            f"{width} and top < bottom within 0 to {height}, not {crop!r}."
        )
    return tuple(int(side) for side in sides)


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything a picture depends on.

    A voxel index (x, y, z) is placed in the world by ``volume_matrix @ scale(scene_scale) @ volume.affine``.
    ``lights`` empty and ``headlight`` False means unlit colours.  ``background`` is scene-linear RGB.
    ``triangles`` are the meshes that stand in or around the volume, (n, 3, 3) float64 world coordinates:
    each ray is integrated only as far as the first of them.
    ``clips``: planes and boxes; what is left of the volume is what each of them keeps.
    ``volume_shadows``: whether lights that cast shadows cast them in the volume: its own, and those of the meshes.
    ``world``: scene-linear RGB radiance that comes from everywhere, None for none.  ``ambient_occlusion``: how much of
    the light from everywhere, the transfer function's ambient light with it, is taken away where the volume or a mesh
    hides the sky; 0 to 1.
    ``labels``: what each voxel belongs to, and what that looks like.  ``channels``: further volumes on the same grid,
    whose extinctions are added, and whose colours by extinction.
    ``crop``: (left, top, right, bottom), half-open, in pixels of the whole frame of ``width`` x ``height``, row 0 on
    top: only these are rendered, bit for bit as they are in the whole frame.  None for all of it.
    ``effects``: name of an effect -> whether it is forced on or off, whatever the rest of the scene calls for.
    ``motion``: Poses from when the shutter opens to when it closes, at equal steps of time; empty for a shutter of no
    time.  The camera's and the volume's own matrices are then those of what stays sharp: the depth.
    ``mode``: one of MODES, what a pixel shows of its ray; see ``ray_modes``.
    ``mist``: towards which colours fade with distance; None for clear air.
    """

    volume: object
    transfer_function: object
    camera: Camera
    width: int = 512
    height: int = 512
    volume_matrix: np.ndarray = field(default_factory=_identity)
    scene_scale: float = 1.0
    lights: tuple = ()
    headlight: bool = True
    background: tuple | None = None
    triangles: np.ndarray | None = None
    crop: tuple | None = None
    effects: dict[str, bool] = field(default_factory=dict)
    motion: tuple = ()
    clips: tuple = ()
    mode: str = "composite"
    mist: Mist | None = None
    volume_shadows: bool = False
    world: tuple | None = None
    ambient_occlusion: float = 0.0
    labels: Labels | None = None
    channels: tuple = ()

    def __post_init__(self):
        if self.mode not in MODES:
            raise RleSplatError(f"There is no mode called {short(self.mode)}; choose {', '.join(MODES)}.")
        if not (self.mist is None or isinstance(self.mist, Mist)):
            raise RleSplatError("The scene's mist must be a Mist, or None for clear air.")
        object.__setattr__(self, "volume_matrix", as_matrix(self.volume_matrix, "The volume's matrix"))
        object.__setattr__(self, "scene_scale", _positive(self.scene_scale, "The scene scale"))
        for name in ("width", "height"):
            value = getattr(self, name)
            if not isinstance(value, (int, np.integer)) or not 1 <= value <= 65536:
                raise RleSplatError(f"The image's {name} must be a whole number from 1 to 65536, not {value!r}.")
            object.__setattr__(self, name, int(value))
        if self.crop is not None:
            object.__setattr__(self, "crop", checked_crop(self.crop, self.width, self.height))
        if not (isinstance(self.effects, dict) and all(isinstance(on, bool) for on in self.effects.values())):
            raise RleSplatError("The scene's effects must name effects, each with true for on or false for off.")
        if len(self.motion) == 1:
            raise RleSplatError("Motion takes two poses or more, from when the shutter opens to when it closes.")
        if not (isinstance(self.clips, tuple) and all(isinstance(clip, Clip) for clip in self.clips)):
            raise RleSplatError("The scene's clips must be a tuple of Clip, planes and boxes.")
        if self.world is not None:
            world = tuple(as_float(c) for c in self.world) if np.iterable(self.world) else ()
            if len(world) != 3 or not np.isfinite(world).all() or min(world) < 0.0:
                raise RleSplatError("The world's light must be three finite numbers, none below zero.")
            object.__setattr__(self, "world", world)
        if not (_is_finite_number(self.ambient_occlusion) and 0.0 <= self.ambient_occlusion <= 1.0):
            raise RleSplatError("The strength of ambient occlusion must be a number from 0 to 1.")
        if self.labels is not None:
            self._check_grid(self.labels.volume, "label volume")
        for channel in self.channels:
            self._check_grid(channel.volume, "channel")

    def _check_grid(self, other, what: str) -> None:
        mine, others = (" x ".join(map(str, one.shape_xyz)) for one in (self.volume, other))
        if mine != others:
            raise RleSplatError(
                f"The {what} has {others} voxels and the volume {mine}; give one that is on the volume's own grid."
            )

    @property
    def region(self) -> tuple[int, int, int, int]:
        """The pixels that are rendered, (left, top, right, bottom): the crop, or the whole frame."""
        return self.crop or (0, 0, self.width, self.height)

    @property
    def index_to_world(self) -> np.ndarray:
        """(4, 4) float64: voxel index (x, y, z, 1) to world."""
        scale = np.diag((self.scene_scale, self.scene_scale, self.scene_scale, 1.0))
        return self.volume_matrix @ scale @ self.volume.affine


@dataclass(frozen=True, eq=False)
class Rendering:
    """A finished picture, row 0 on top: the scene's crop, or its whole frame.

    ``rgba``: (H, W, 4) float32, scene-linear, premultiplied, without the background.
    ``depth``: (H, W) float32, planar distance along the camera's axis in world units at which the
    transmittance falls below one half, ``NO_DEPTH`` where it never does.  ``report``: JSON-ready dict.
    """

    rgba: np.ndarray
    depth: np.ndarray
    report: dict


NO_DEPTH = 1e10
