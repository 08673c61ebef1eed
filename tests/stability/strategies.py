"""Scenes and plans of any kind for hypothesis to choose from: volumes, affines, cameras, transfer functions, qualities.

A volume's voxels come from a seed and a few words, so that an example is short to read and to keep.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.scene import (
    CLASSIFICATIONS,
    FOOTPRINTS,
    MINIFICATIONS,
    MODELS,
    NAMED_DEPTH_RULES,
    POST_ONLY,
    RECORDS,
    WARP_FILTERS,
    Camera,
    Light,
    Quality,
    Scene,
)  # fmt: skip
from rle_splat.volume.volume import Volume

DTYPES = ("uint8", "int16", "float32", "float64")  # every kind of stored type; the others: test_values
FIELDS = ("noise", "constant", "blobs", "sheet", "sparse", "checkerboard", "ramp")
CURVES = ("ramp", "narrow", "steps", "solid", "any")
SEEDS = st.integers(0, 2**32 - 1)
UNIT = st.floats(0.0, 1.0)


# --- fields ---------------------------------------------------------------------------------------------------


def field_of(kind: str, shape, random) -> np.ndarray:
    """(nz, ny, nx) float64 in [0, 1] of one of FIELDS."""
    z, y, x = np.indices(shape)
    if kind == "noise":
        return random.random(shape)
    if kind == "constant":
        return np.full(shape, random.random())
    if kind == "sheet":
        axis = int(random.integers(3))
        return 1.0 * (np.indices(shape)[axis] == random.integers(shape[axis]))
    if kind == "sparse":
        return random.random(shape) * (random.random(shape) < 0.05)
    if kind == "checkerboard":
        return 1.0 * ((x + y + z) % 2)
    if kind == "ramp":
        slope = random.standard_normal(3)
        along = slope[0] * x + slope[1] * y + slope[2] * z
        return (along - along.min()) / max(float(np.ptp(along)), 1e-9)
    return smooth_field(shape, random)


def smooth_field(shape, random, width=(1.6, 2.6)) -> np.ndarray:
    """(nz, ny, nx) float64 in [0, 1]: a few Gaussian blobs of ``width`` voxels, zero and flat at the faces."""
    position = np.moveaxis(np.indices(shape), 0, -1).astype(np.float64)
    total = np.zeros(shape)
    for _ in range(int(random.integers(1, 6))):
        middle = random.uniform(0.3, 0.7, 3) * (np.array(shape) - 1.0)
        total += random.uniform(0.3, 1.0) * np.exp(
            -0.5 * ((position - middle) ** 2).sum(axis=-1) / random.uniform(*width) ** 2
        )
    total = np.clip(total, 0.0, None) / max(float(total.max()), 1e-9)
    edge = np.minimum.reduce([np.minimum(i, n - 1 - i) for i, n in zip(np.indices(shape), shape, strict=True)])
    return total * np.clip(edge / 3.0, 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip(edge / 3.0, 0.0, 1.0))


def stored(field, dtype: str) -> np.ndarray:
    """A field of [0, 1] as stored values: 0 to 250 without a sign, -100 to 150 with one."""
    kind = np.dtype(dtype).kind
    values = 250.0 * field - (0.0 if kind == "u" else 100.0)
    return values.astype(dtype) if kind == "f" else np.rint(values).astype(dtype)


@st.composite
def volumes(draw, most: int = 9):
    """Any field in any stored type, one voxel thick or up to ``most``; NaN and infinities among floats."""
    shape = draw(st.tuples(*[st.integers(1, most)] * 3))
    random = np.random.default_rng(draw(SEEDS))
    dtype = draw(st.sampled_from(DTYPES))
    voxels = stored(field_of(draw(st.sampled_from(FIELDS)), shape, random), dtype)
    if voxels.dtype.kind == "f" and draw(st.booleans()):
        for odd in draw(st.lists(st.sampled_from((np.nan, np.inf, -np.inf)), min_size=1, max_size=3)):
            voxels[random.random(shape) < 0.1] = odd
    slope, intercept = draw(st.sampled_from(((1.0, 0.0), (-2.5, 0.125), (0.37, -11.0), (1e-3, 1e3), (1e6, 0.0))))
    return Volume(voxels, draw(affines()), slope=slope, intercept=intercept)


# --- places ---------------------------------------------------------------------------------------------------


def rotation(random) -> np.ndarray:
    """(3, 3): any, equally likely."""
    q, r = np.linalg.qr(random.standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


@st.composite
def affines(draw, anisotropy: float = 50.0, shear: float = 1.0):
    """(4, 4): turned, sheared, mirrored, stretched by up to ``anisotropy``, and moved."""
    random = np.random.default_rng(draw(SEEDS))
    spacing = np.exp([draw(st.floats(0.0, math.log(anisotropy))) for _ in range(3)])
    lean = np.eye(3) + np.triu(random.uniform(-shear, shear, (3, 3)), 1) * draw(st.sampled_from((0.0, 0.5, 1.0)))
    turn = rotation(random) if draw(st.booleans()) else np.eye(3)
    flips = np.diag([draw(st.sampled_from((1.0, -1.0))) for _ in range(3)])
    matrix = np.eye(4)
    matrix[:3, :3] = draw(st.sampled_from((1.0, 1e-3, 1e3))) * turn @ lean @ np.diag(spacing) @ flips
    matrix[:3, 3] = random.uniform(-100.0, 100.0, 3) * draw(st.sampled_from((0.0, 1.0)))
    return matrix


WHOLE = st.sampled_from((None, None, "start", "end", "both"))  # which clip planes cut the volume


@st.composite
def cameras(draw, index_to_world, shape_xyz, widest=165.0, shift=1.0, framed=False, clipped=WHOLE):
    """Parallel and perspective, outside and inside, on voxels and between them, shifted, clipped, wide.

    ``framed``: the volume fills a good part of the picture."""
    random = np.random.default_rng(draw(SEEDS))
    counts = np.array(shape_xyz, dtype=np.float64)

    def world(index):
        return index_to_world[:3, :3] @ index + index_to_world[:3, 3]

    corners = np.array([world(counts * c - 0.5) for c in np.ndindex(2, 2, 2)])
    middle = corners.mean(axis=0)
    reach = float(np.linalg.norm(corners - middle, axis=1).max())
    kind = draw(st.sampled_from(("PERSP", "ORTHO")))
    fov = draw(st.floats(8.0, widest))
    along = random.standard_normal(3)
    if draw(st.integers(0, 3)) == 0:  # along an axis of the volume, or between two or three of them
        along = index_to_world[:3, :3] @ np.array([draw(st.sampled_from((-1.0, 0.0, 1.0))) for _ in range(3)])
    along = along / np.linalg.norm(along) if np.linalg.norm(along) > 0.0 else np.array((0.0, 0.0, 1.0))
    away = reach * draw(st.floats(1.05, 6.0))
    if framed:
        away = reach * max(1.05, draw(st.floats(0.5, 2.5)) / (2.0 * math.tan(math.radians(0.5 * fov))))
    aim, eye = middle, middle - away * along
    if draw(st.integers(0, 2)) == 0:
        index = random.uniform(-1.0, counts)
        eye = world(draw(st.sampled_from((index, np.rint(index), np.floor(index) + 0.5))))
        aim = eye + along
        away = reach
    ahead = (aim - eye) / np.linalg.norm(aim - eye)
    right = np.cross(ahead, random.standard_normal(3))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack((right, np.cross(right, ahead), -ahead), axis=1)
    pose[:3, 3] = eye
    cut = draw(clipped)
    clip = [1e-4 * reach, 1e4 * reach]
    if cut in ("start", "both"):
        clip[0] = max(away + draw(st.floats(-0.9, 0.2)) * reach, clip[0])
    if cut in ("end", "both"):
        clip[1] = max(away + draw(st.floats(0.2, 0.9)) * reach, 1.5 * clip[0])
    return Camera(
        pose, kind, lens=18.0 / math.tan(math.radians(0.5 * fov)), ortho_scale=reach * draw(st.floats(0.5, 3.0)),
        shift_x=shift * draw(st.floats(-1.0, 1.0)) * draw(st.sampled_from((0.0, 0.3, 1.0))),
        shift_y=shift * draw(st.floats(-1.0, 1.0)) * draw(st.sampled_from((0.0, 0.3, 1.0))),
        clip_start=clip[0], clip_end=clip[1], pixel_aspect=draw(st.sampled_from(((1.0, 1.0), (1.0, 2.0)))),
        sensor_fit=draw(st.sampled_from(("AUTO", "HORIZONTAL", "VERTICAL"))),
    )  # fmt: skip


# --- transfer functions ------------------------------------------------------------------------------------


def value_range(volume) -> tuple[float, float]:
    """The finite physical values' ends, never the same."""
    values = volume.physical(volume.voxels)
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    return low, high if high > low else low + 1.0


@st.composite
def transfer_functions(draw, low, high, distance, curves=CURVES):
    """Narrow, wide, with steps, opaque or any; emissive or not.  ``distance``: about what opacities refer to."""

    def at(share):
        return low + share * (high - low)

    curve, most = draw(st.sampled_from(curves)), draw(st.sampled_from((1e-6, 0.05, 0.5, 0.95, 1.0)))
    first = draw(UNIT)
    if curve == "ramp":
        opacity = ((at(0.3 * first), 0.0), (at(1.0), most))
    elif curve == "narrow":
        opacity = tuple((at(first + d), most * (d == 0.0)) for d in (-0.01, 0.0, 0.01))
    elif curve == "steps":
        opacity = ((at(first), 0.0), (at(first), most), (at(first + 0.3), most), (at(first + 0.3), 0.5 * most))
    elif curve == "solid":
        opacity = ((at(0.0), most),)
    else:
        opacity = tuple((at(draw(st.floats(-0.2, 1.2))), most * draw(UNIT)) for _ in range(draw(st.integers(1, 5))))
    bright = draw(st.sampled_from((1.0, 1.0, 300.0)))
    color = tuple((at(draw(UNIT)), *(bright * draw(UNIT) for _ in range(3))) for _ in range(draw(st.integers(1, 3))))
    length = distance * draw(st.sampled_from((0.01, 1.0, 1.0, 30.0)))
    shade = draw(st.sampled_from((None, Shade(), Shade(0.0, 1.0, 0.5, 5.0))))
    return TransferFunction(opacity=opacity, color=color, opacity_unit_distance=length, shade=shade)


# --- all at once ----------------------------------------------------------------------------------------------


@st.composite
def scenes(draw, most_pixels: int = 20):
    """Any volume, seen by any camera, with any transfer function."""
    volume = draw(volumes())
    place = draw(affines(3.0))
    scene_scale = draw(st.sampled_from((1.0, 1e-3, 1e3)))
    index_to_world = place @ np.diag((scene_scale, scene_scale, scene_scale, 1.0)) @ volume.affine
    camera = draw(cameras(index_to_world, volume.shape_xyz))
    tf = draw(transfer_functions(*value_range(volume), float(volume.spacing.min())))
    lights = ()
    if draw(st.integers(0, 3)) == 0:
        pose = np.eye(4)
        pose[:3, 3] = index_to_world[:3, 3] + draw(UNIT) * index_to_world[:3, :3].sum(axis=1)
        lights = (Light(draw(st.sampled_from(("SUN", "POINT", "SPOT", "AREA"))), energy=10.0, matrix_world=pose),)
    width, height = draw(st.integers(1, most_pixels)), draw(st.integers(1, most_pixels))
    return Scene(
        volume, tf, camera, width, height, place, scene_scale, lights, headlight=draw(st.booleans())
    )  # fmt: skip


@st.composite
def plain_scenes(
    draw, fields=FIELDS, curves=CURVES, sizes=(3, 9), most_pixels=24, anisotropy=10.0, holes=False, **camera
):
    """An unlit medium with an optical depth of up to 3 across a cell's diagonal: what plans converge to the oracle on.

    ``holes``: some voxels may be no numbers."""
    shape = draw(st.tuples(*[st.integers(*sizes)] * 3))
    random = np.random.default_rng(draw(SEEDS))
    dtype = draw(st.sampled_from(DTYPES))
    voxels = stored(field_of(draw(st.sampled_from(fields)), shape, random), dtype)
    if holes and voxels.dtype.kind == "f" and draw(st.booleans()):
        voxels[random.random(shape) < 0.1] = np.nan
    volume = Volume(voxels, draw(affines(anisotropy, 0.5)))
    diagonal = float(np.linalg.norm(volume.affine[:3, :3], axis=0).sum())
    low, high = value_range(volume)
    tf = draw(transfer_functions(low, high, diagonal, curves))
    if curves == ("ramp",):  # nor may colors change faster than that
        tf = replace(tf, color=((low, *tf.color[0][1:]), (high, *tf.color[-1][1:])))
    mild = tuple((value, min(alpha, 0.95)) for value, alpha in tf.opacity)
    tf = replace(tf, opacity=mild, opacity_unit_distance=diagonal, shade=None)
    seen = draw(cameras(volume.affine, volume.shape_xyz, framed=True, **camera))
    return Scene(volume, tf, seen, most_pixels, most_pixels, headlight=False)


@st.composite
def qualities(draw):
    """Any plan that there is."""
    classification = draw(st.sampled_from(CLASSIFICATIONS))
    rules = [*NAMED_DEPTH_RULES, "midpoint-1", "midpoint-3", "midpoint-8"]
    free = classification != "post"
    minification = draw(st.sampled_from(MINIFICATIONS)) if free else POST_ONLY["minification"]
    if not free:
        rules += ["preintegrated", "preintegrated-2"]
    return Quality(
        classification=classification, depth_rule=draw(st.sampled_from(rules)),
        sheet_density=draw(st.sampled_from((0.0, 0.5, 0.7, 1.0, 1.5, 3.0))),
        warp_filter=draw(st.sampled_from(WARP_FILTERS)),
        termination=draw(st.sampled_from((0.0, 1 / 8192, 1 / 1024, 1 / 256, 0.1))),
        kernel=draw(st.sampled_from(FOOTPRINTS)) if free else POST_ONLY["kernel"],
        minification=minification,
        model=draw(st.sampled_from(MODELS)) if free else POST_ONLY["model"],
        length_correction=draw(st.booleans()) if free else POST_ONLY["length_correction"],
        record=draw(st.sampled_from(RECORDS)) if free else POST_ONLY["record"],
        threads=1,
    )  # fmt: skip
