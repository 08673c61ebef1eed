"""Probe pixels of a scene and the truth there, looked up once for every picture of it that is judged."""

from __future__ import annotations

import numpy as np

from ...effects.mesh_depth import mesh_depth
from ...runtime.steps import Progress
from ...scene import Quality, Scene, truth_of
from ...view.eye import index_view
from ...view.footprints import FOOTPRINTS
from ...view.ray_limits import box_depths
from ..lighting import shading_of
from ..measure import TOLERANCE
from ..probes import choose_probes, judge, probe_errors
from ..truths import truth

DOUBTFUL_SHARE = 0.5  # as many probes more, of the ordinary ones, go to where the picture is doubtful
FIRST_SHARE = 0.25  # of the probes are looked up first: a picture that fails at these needs no more
PIXELS_FROM_MESHES = 6  # that the warp's filter and its prefilter may reach from a pixel whose ray ends at a mesh
RAYS_AT_ONCE = 256  # of a truth: a tenth of a second or so between two looks at the user's Esc


class Judge:
    """Probe pixels of a scene and their truth, each looked up once for all rounds.

    ``columns``, ``rows``: (n,) ints, in the picture, of all that were looked up so far; ``errors_of`` goes with them.
    """

    def __init__(self, scene: Scene, quality: Quality, count: int, seed: int):
        self._scene, self._name = scene, truth_of(quality)
        self._count, self._seed = count, seed
        self._free = _free_of_meshes(scene, quality)
        self._shading = shading_of(scene, self._name)
        self._waiting: list[tuple] | None = None  # ordinary probes that are still to be looked up
        self._known = np.zeros(self._free.shape, bool)
        self._random = np.empty(0, bool)
        self.columns, self.rows, self._true = np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 4))

    @property
    def doubtful(self) -> int:
        """How many doubtful pixels to name."""
        return int(DOUBTFUL_SHARE * self._count)

    def steps(self, rgba, doubtful, tolerance: float, begin: float, end: float):
        """Generator of Progress; returns what ``probes.judge`` says of a picture, None without a pixel to look at.

        ``doubtful``: columns and rows of pixels that it may get wrong.  A picture that errs more than the tolerance at
        a part of the probes is judged by them.
        """
        if self._waiting is None:
            self._waiting = self._ordinary(rgba)
        parts = self._waiting
        more = _spread(np.stack(doubtful)), np.zeros(len(doubtful[0]), bool)
        while True:
            first = len(parts) > 1
            share = slice(0, len(more[1]) // 4) if first else slice(None)
            places, random = parts[0] if parts else (np.empty((2, 0), np.int64), np.empty(0, bool))
            places = np.concatenate((places, more[0][:, share]), axis=1)
            middle = begin + (end - begin) * (0.5 if first else 1.0)
            yield from self._look_up(places, np.concatenate((random, more[1][share])), begin, middle)
            begin, parts = middle, parts[1:]
            self._waiting = parts
            if not len(self.columns):
                return None
            errors = self.errors_of(rgba)
            if not first or errors.max() > tolerance:
                break
        order = np.argsort(~self._random, kind="stable")
        return judge(errors[order], int(self._random.sum()), tolerance)

    def errors_of(self, rgba) -> np.ndarray:
        """(n,) levels: the errors of a picture at all probes so far."""
        return probe_errors(rgba[self.rows, self.columns], self._true)

    def _ordinary(self, rgba) -> list[tuple]:
        """Places (2, n) and which are random, of FIRST_SHARE of the probes and of the others."""
        probes = choose_probes(rgba, self._count, self._seed)
        random = np.arange(len(probes.columns)) < probes.random
        # Both shares are like the whole: random ones from everywhere, and steep ones.
        order = np.random.default_rng(self._seed).permutation(len(random))
        places, random = np.stack((probes.columns, probes.rows))[:, order], random[order]
        cut = int(np.ceil(FIRST_SHARE * len(random)))
        return [(places[:, :cut], random[:cut]), (places[:, cut:], random[cut:])]

    def _look_up(self, places, random, begin: float, end: float):
        """Generator of Progress: more probes, where no mesh has a part in them and none was before."""
        columns, rows = places
        new = self._free[rows, columns] & ~(self._known[rows, columns] & ~random)
        columns, rows, random = columns[new], rows[new], random[new]
        self._known[rows, columns] = True
        left, top = self._scene.region[:2]
        found = [self._true]
        for first in range(0, len(columns), RAYS_AT_ONCE):
            yield Progress(begin + (end - begin) * first / len(columns), "Measuring the error at probe pixels")
            part = slice(first, first + RAYS_AT_ONCE)
            centres = columns[part] + left + 0.5, rows[part] + top + 0.5
            found.append(truth(self._scene, self._name, pixels=centres, tolerance=TOLERANCE, **self._shading)[0])
        self.columns, self.rows = np.concatenate((self.columns, columns)), np.concatenate((self.rows, rows))
        self._random, self._true = np.concatenate((self._random, random)), np.concatenate(found)


def _spread(places: np.ndarray) -> np.ndarray:
    """Places (2, n) in an order of which every beginning is from everywhere."""
    return places[:, np.random.default_rng(0).permutation(places.shape[1])]


def _free_of_meshes(scene: Scene, quality: Quality) -> np.ndarray:
    """(H, W) bool: pixels whose picture no mesh has any part in."""
    left, top, right, bottom = scene.region
    if scene.triangles is None or len(scene.triangles) == 0:
        return np.ones((bottom - top, right - left), dtype=bool)
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    furthest = box_depths(view, scene.volume.shape_xyz, FOOTPRINTS[quality.kernel].radius)[1]
    reach = PIXELS_FROM_MESHES
    around = (
        max(left - reach, 0), max(top - reach, 0), min(right + reach, scene.width), min(bottom + reach, scene.height)
    )  # fmt: skip
    samples = mesh_depth(
        scene.triangles, scene.camera, scene.width, scene.height, region=around, backend=quality.backend,
        threads=quality.threads,
    )  # fmt: skip
    ended = (samples < furthest).any(axis=-1)
    padded = np.pad(ended, reach)
    near = np.zeros_like(ended)
    for down in range(2 * reach + 1):
        for across in range(2 * reach + 1):
            near |= padded[down : down + ended.shape[0], across : across + ended.shape[1]]
    return ~near[top - around[1] : bottom - around[1], left - around[0] : right - around[0]]
