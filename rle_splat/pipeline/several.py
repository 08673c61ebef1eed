"""Several volumes in one picture.

Volumes whose boxes do not overlap are rendered one by one and laid over one another.  Of boxes that overlap, each
volume is rendered in spans of planar depth, between the same clip planes.  Within a span the volumes are mixed as if
each were homogeneous along its rays: optical depths add up, and colors are averaged by optical depth.  That is exact
for homogeneous volumes, has no order of its own, and converges as spans become thin.
"""

from collections.abc import Callable, Generator
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from ..runtime.steps import Progress, rescale
from ..scene import MODES, NO_DEPTH, Rendering, Scene
from ..scene.changed import change
from ..view.box_order import box_of, near_to_far
from ..view.projection import depth_row, world_to_pixel

MOST_SPANS = 16  # in which overlapping volumes are mixed
MARGIN = 4  # pixels by which the warp reaches beyond a box
VOXELS = 2.0  # depth of a span, in sides of the smallest voxel
OPAQUE = 1.0 - 1e-7  # an opacity above it has this one's optical depth
BAND = 1 << 15  # pixels that are mixed at a time, which stay in the processor's cache
SLICED = "volumes that overlap are rendered in spans of depth"
LAID = "Overlapping volumes are not mixed but drawn over one another, the nearest on top, because"


def several_steps(scenes: list[Scene], make: Callable[[Scene, int], Generator], most_spans: int = MOST_SPANS):
    """Generator of Progress: one picture of several volumes.

    Parameters
    ----------
    scenes : list of Scene
        Of the same camera, size and crop, one for each volume.
    make : callable
        ``make(scene, n)`` is a generator that returns the Rendering of volume number ``n``, or of a span of it,
        transparent where it shows nothing.
    most_spans : int
        In which overlapping volumes are mixed; 1 lays them over one another.

    Returns
    -------
    Rendering
        Its report is that of the first scene, with the remarks of all and, as ``volumes``, how many there are, in how
        many pictures they were rendered and whether any were mixed. The depth of a pixel whose transmittance falls
        below one half in a mixture is exact where the mixture is homogeneous.
    """
    camera = scenes[0].camera
    groups = near_to_far([_box(scene) for scene in scenes], camera)
    reason = _find_obstacle(scenes) if most_spans > 1 else "a maximum error is set"
    overlap = any(len(group) > 1 for group in groups)
    layers = [_Layer(scenes, group, 0 if reason else most_spans) for group in groups]
    total, picture, reports = sum(layer.pictures for layer in layers), None, []

    def make_next(scene: Scene, n: int):
        done = len(reports)
        rendering = yield from rescale(make(scene, n), done / total, (done + 1) / total)
        reports.append((n, rendering.report))
        return rendering.rgba, rendering.depth

    def combine(function, *pictures):
        made = tuple(np.empty_like(plane) for plane in pictures[0])
        rows = max(BAND // made[0].shape[1], 1)
        for first in range(0, len(made[0]), rows):
            band = slice(first, first + rows)
            for plane, found in zip(made, function(*((rgba[band], depth[band]) for rgba, depth in pictures))):
                plane[band] = found
            yield Progress(len(reports) / total, "Mixing volumes")
        return made

    for layer in layers:
        found = yield from layer.steps(make_next, combine)
        picture = found if picture is None else (yield from combine(_lay_over, picture, found))
    about = {"count": len(scenes), "pictures": total, "mixed": overlap and not reason}
    return Rendering(*picture, _sum_reports(reports, about, f"{LAID} {reason}." if overlap and reason else ""))


class _Layer:
    """Volumes of a group: laid over one another, and mixed in spans in the pixels that show several.

    ``numbers``: of the group, in ``scenes``.  ``most_spans``: 0 mixes none.
    """

    def __init__(self, scenes: list[Scene], numbers: list[int], most_spans: int):
        self._scenes = scenes
        self._order = sorted(numbers, key=lambda n: float(_depths(scenes[n]).mean()))
        self._shared = find_shared_pixels([scenes[n] for n in numbers]) if most_spans and len(numbers) > 1 else None
        self._spans = cut_spans([scenes[n] for n in numbers], numbers, most_spans) if self._shared else []
        if self._shared == scenes[0].region:
            self._order = []

    @property
    def pictures(self) -> int:
        """How many pictures of single volumes it takes."""
        return len(self._order) + sum(len(inside) for inside, _ in self._spans)

    def steps(self, make: Callable, combine: Callable):
        """Generator of Progress: the picture and its depth.

        ``combine(function, *pictures)`` is a generator that returns ``function(*pictures)``.
        """
        whole = mixed = None
        for n in self._order:
            found = yield from make(self._scenes[n], n)
            whole = found if whole is None else (yield from combine(_lay_over, whole, found))
        for inside, span in self._spans:
            made = []
            for n in inside:
                of_span = replace(self._scenes[n], crop=self._shared)
                if span is not None:
                    near, far = map(float, span)
                    of_span = replace(of_span, camera=change(of_span.camera, clip_start=near, clip_end=far))
                made.append((yield from make(of_span, n)))
            found, is_mixture = made[0], len(made) > 1
            if is_mixture:
                found = yield from combine(partial(_mix, span=span), *made)
            if mixed is not None:
                found = yield from combine(partial(_lay_over, span=span if is_mixture else None), mixed, found)
            mixed = found
        if whole is None or mixed is None:
            return whole or mixed
        left, top, right, bottom = self._shared
        x, y = self._scenes[0].region[:2]
        held = slice(top - y, bottom - y), slice(left - x, right - x)
        for picture, patch in zip(whole, mixed):
            picture[held] = patch
        return whole


def find_shared_pixels(scenes: list[Scene]) -> tuple[int, int, int, int] | None:
    """The pixels that may show more than one of several volumes.

    Returns
    -------
    (left, top, right, bottom) or None
        Within the region that is rendered, with a margin; None where no pixel shows several.
    """
    found = [_pixels_of(scene) for scene in scenes]
    pairs = [
        (*np.maximum(one[:2], other[:2]), *np.minimum(one[2:], other[2:]))
        for n, one in enumerate(found) for other in found[n + 1 :]
    ]  # fmt: skip
    pairs = [(left, top, right, bottom) for left, top, right, bottom in pairs if left < right and top < bottom]
    if not pairs:
        return None
    sides = np.array(pairs)
    return *(int(side) for side in sides[:, :2].min(axis=0)), *(int(side) for side in sides[:, 2:].max(axis=0))


def _pixels_of(scene: Scene) -> np.ndarray:
    """(4,) int64 left, top, right, bottom of the pixels of the region that a volume's box covers."""
    region = np.array(scene.region)
    corners = np.column_stack((_box(scene), np.ones(8)))
    column, row, depth = world_to_pixel(scene.camera, scene.width, scene.height) @ corners.T
    if (depth <= 1e-6 * np.abs(depth).max()).any():  # the eye is inside, or beside
        return region
    across, down = column / depth, row / depth
    low = np.floor((across.min(), down.min())) - MARGIN
    high = np.ceil((across.max(), down.max())) + MARGIN
    held = np.clip((*low, *high), -1e9, 1e9).astype(np.int64)
    return np.concatenate((np.maximum(held[:2], region[:2]), np.minimum(held[2:], region[2:])))


def _sum_reports(reports: list[tuple], about: dict, remark: str) -> dict:
    """The first volume's report with the times and remarks of all; ``reports``: (number, report) of each picture."""
    # Spans leave out a volume that lies outside of the clip distances.
    first = next((report for n, report in reports if n == 0), reports[0][1])
    remarks = [remark for _, report in sorted(reports, key=lambda one: one[0]) for remark in report["remarks"]]
    stages = {name: sum(report["stages_ms"][name] for _, report in reports) for name in first["stages_ms"]}
    cut = {"reason": SLICED} if about["mixed"] else {}
    effects = [{**row, **cut} if row["name"] == "clipping" else row for row in first["effects"]]
    remarks = list(dict.fromkeys([*remarks, *filter(None, [remark])]))
    return {**first, "remarks": remarks, "stages_ms": stages, "effects": effects, "volumes": about}


def cut_spans(scenes: list[Scene], numbers: list[int], most: int) -> list[tuple]:
    """Planar depths between which overlapping volumes are rendered, from near to far.

    Parameters
    ----------
    numbers : list of int
        Of the scenes.
    most : int
        Spans in which several volumes are mixed.

    Returns
    -------
    list of (list of int, (float, float))
        The numbers of the scenes that reach into a span, and its depths in world units. The first begins and the last
        ends at the camera's own clip distances.
    """
    camera = scenes[0].camera
    ranges = [np.clip(_depths(scene)[[0, -1]], camera.clip_start, camera.clip_end) for scene in scenes]
    cuts = sorted({float(depth) for ends in ranges for depth in ends})
    found = []
    for span in pairwise(cuts):
        inside = [n for n, (near, far) in zip(numbers, ranges) if near <= span[0] and far >= span[1]]
        if inside and found and found[-1][0] == inside:
            found[-1] = inside, (found[-1][1][0], span[1])
        elif inside:
            found.append((inside, span))
    if not found:  # all is outside of the clip distances
        return [([n], None) for n in numbers]
    shared = sum(end - begin for inside, (begin, end) in found if len(inside) > 1)
    least = min(np.linalg.norm(scene.index_to_world[:3, axis]) for scene in scenes for axis in range(3))
    thickness = max(VOXELS * float(least), shared / most)
    parts = []
    for inside, (begin, end) in found:
        count = max(int(np.ceil((end - begin) / thickness * (1.0 - 1e-9))), 1) if len(inside) > 1 else 1
        edges = np.linspace(begin, end, count + 1).tolist()
        parts += [(inside, span) for span in pairwise(edges)]
    parts[0] = parts[0][0], (camera.clip_start, parts[0][1][1])
    parts[-1] = parts[-1][0], (parts[-1][1][0], camera.clip_end)
    return parts


def _find_obstacle(scenes: list[Scene]) -> str:
    """Why overlapping volumes cannot be mixed; "" where they can."""
    first = scenes[0]
    if any(scene.motion for scene in scenes):
        return "motion blur is on"
    if first.camera.aperture_radius > 0.0 and first.effects.get("depth of field") is not False:
        return "depth of field is on"
    if any(scene.mode != MODES[0] for scene in scenes):
        return "the mode shows values along whole rays"
    return "clipping is turned off by hand" if first.effects.get("clipping") is False else ""


def _box(scene: Scene) -> np.ndarray:
    return box_of(scene.index_to_world, scene.volume.shape_xyz)


def _depths(scene: Scene) -> np.ndarray:
    """(8,) float64 planar depths of the corners of a volume's box, ascending."""
    row = depth_row(scene.camera)
    return np.sort(_box(scene) @ row[:3] + row[3])


def _mix(*made: tuple, span) -> tuple[np.ndarray, np.ndarray]:
    """The picture and the depth of a span from those of its volumes."""
    if not any(rgba[..., 3].any() for rgba, _ in made):
        return np.zeros_like(made[0][0]), np.full_like(made[0][1], NO_DEPTH)
    pictures = np.stack([rgba for rgba, _ in made]).astype(np.float64)
    opacity = pictures[..., 3:]
    depths = -np.log1p(-np.clip(opacity, 0.0, OPAQUE))
    colors = np.divide(pictures[..., :3], opacity, out=np.zeros_like(pictures[..., :3]), where=opacity > 0.0)
    whole = depths.sum(axis=0)
    mean = np.divide((depths * colors).sum(axis=0), whole, out=np.zeros_like(colors[0]), where=whole > 0.0)
    alpha = 1.0 - np.prod(1.0 - opacity, axis=0)
    rgba = np.concatenate((alpha * mean, alpha), axis=-1).astype(np.float32)
    return rgba, _half_depth(np.zeros(whole.shape[:2]), whole[..., 0], span)


def _lay_over(front: tuple, back: tuple, span=None) -> tuple[np.ndarray, np.ndarray]:
    """A picture over another one, and the depth of both; ``span``: depths of the back one if it is of a mixture."""
    (near, near_depth), (far, far_depth) = front, back
    rgba = near + (1.0 - near[..., 3:]) * far
    if span is not None:
        before, within = (-np.log1p(-np.clip(one[..., 3].astype(np.float64), 0.0, OPAQUE)) for one in (near, far))
        far_depth = _half_depth(before, within, span)
    return rgba, np.where(near_depth < np.float32(NO_DEPTH), near_depth, far_depth)


def _half_depth(before: np.ndarray, within: np.ndarray, span) -> np.ndarray:
    """(H, W) float32 planar depth at which the transmittance falls below one half in a homogeneous span.

    ``before``, ``within``: (H, W) optical depths in front of the span and in it.
    """
    half = np.log(2.0)
    share = np.divide(half - before, within, out=np.zeros_like(within), where=within > 0.0)
    found = span[0] + np.clip(share, 0.0, 1.0) * (span[1] - span[0])
    return np.where(before + within >= half, found, NO_DEPTH).astype(np.float32)
