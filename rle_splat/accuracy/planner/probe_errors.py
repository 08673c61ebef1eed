"""Probe errors: the truth at pixels of a scene, and how far its pictures are from it there."""

import numpy as np

from ...effects.mesh_depth import mesh_depth
from ...runtime.steps import announce
from ...scene import Quality, Scene, truth_of
from ...view.eye import index_view
from ...view.footprints import FOOTPRINTS
from ..lighting import shading_of
from ..probes import choose_probes, error_summary, probe_errors, truth_tolerance
from ..truths import truth_steps

SUSPECT_SHARE = 0.5  # of the number of ordinary probes: probes more, where the error estimate is largest
FIRST_SHARE = 0.25  # of the probes are integrated first: a picture that fails at these needs no others
PIXELS_FROM_MESHES = 6  # the reach of the warp's filter and prefilter from a pixel whose ray ends at a mesh


def true_pixel_steps(scene: Scene, name: str, columns, rows, begin: float, end: float):
    """Integrate the truth ``name`` at pixels.  Generator of Progress from ``begin`` to ``end``.

    ``columns``, ``rows``: (n,) float positions, pixel centers at + 0.5.  Returns (n, 4) float64.
    """
    shading = shading_of(scene, name)
    steps = truth_steps(scene, name, columns, rows, truth_tolerance(shading), **shading)
    return announce(steps, begin, end, f"Integrating the reference {name}")


class ProbeErrors:
    """Errors of one scene's pictures at probe pixels.  The truth of each probe is integrated once, for all pictures.

    Parameters
    ----------
    scene : Scene
        Without the effects that are off.
    quality : Quality
        Its classification names the truth.
    count : int
        Ordinary probes, random and steep ones.

    Attributes
    ----------
    columns, rows : (n,) int64
        All probes so far, in the picture.
    """

    def __init__(self, scene: Scene, quality: Quality, count: int, seed: int):
        self._scene, self._name = scene, truth_of(quality)
        self._count, self._seed = count, seed
        self._free = _free_of_meshes(scene, quality)
        self._shading = shading_of(scene, self._name)
        self._waiting: list[tuple] | None = None  # ordinary probes that are not integrated yet
        self._known = np.zeros(self._free.shape, bool)
        self._random = np.empty(0, bool)
        self.columns, self.rows, self._true = np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 4))

    @property
    def suspect_count(self) -> int:
        """The number of suspects that ``steps`` should be given."""
        return int(SUSPECT_SHARE * self._count)

    def steps(self, rgba, suspects, tolerance: float, begin: float, end: float):
        """Measure a picture.  Generator of Progress from ``begin`` to ``end``.

        A picture that errs more than the tolerance at the first part of the probes is not measured at the others.

        Parameters
        ----------
        rgba : (H, W, 4) float32
        suspects : tuple of (m,) int
            Columns and rows of the pixels of the largest error estimates.
        tolerance : float
            Levels.

        Returns
        -------
        dict or None
            As ``probes.error_summary``; None where there is no pixel to measure.
        """
        if self._waiting is None:
            self._waiting = self._ordinary(rgba)
        parts = self._waiting
        more = _spread(np.stack(suspects)), np.zeros(len(suspects[0]), bool)
        while True:
            first = len(parts) > 1
            share = slice(0, len(more[1]) // 4) if first else slice(None)
            pixels, random = parts[0] if parts else (np.empty((2, 0), np.int64), np.empty(0, bool))
            pixels = np.concatenate((pixels, more[0][:, share]), axis=1)
            middle = begin + (end - begin) * (0.5 if first else 1.0)
            yield from self._integrate(pixels, np.concatenate((random, more[1][share])), begin, middle)
            begin, parts = middle, parts[1:]
            self._waiting = parts
            if not len(self.columns):
                return None
            if not first or self.errors_of(rgba).max() > tolerance:
                return self.summary(rgba, tolerance)

    def summary(self, rgba, tolerance: float) -> dict:
        """As ``probes.error_summary``: the errors of a picture at all probes so far."""
        order = np.argsort(~self._random, kind="stable")
        return error_summary(self.errors_of(rgba)[order], int(self._random.sum()), tolerance)

    def errors_of(self, rgba) -> np.ndarray:
        """(n,) levels: the errors of a picture at all probes so far."""
        return probe_errors(rgba[self.rows, self.columns], self._true)

    def _ordinary(self, rgba) -> list[tuple]:
        """Pixels (2, n) and which are random (n,) bool, of FIRST_SHARE of the probes and of the others."""
        probes = choose_probes(rgba, self._count, self._seed)
        random = np.arange(len(probes.columns)) < probes.random
        # Both parts hold random probes from everywhere, and steep ones.
        order = np.random.default_rng(self._seed).permutation(len(random))
        pixels, random = np.stack((probes.columns, probes.rows))[:, order], random[order]
        cut = int(np.ceil(FIRST_SHARE * len(random)))
        return [(pixels[:, :cut], random[:cut]), (pixels[:, cut:], random[cut:])]

    def _integrate(self, pixels, random, begin: float, end: float):
        """Generator of Progress: add probes (2, n), without those near meshes and those that are known."""
        columns, rows = pixels
        new = self._free[rows, columns] & ~(self._known[rows, columns] & ~random)
        columns, rows, random = columns[new], rows[new], random[new]
        self._known[rows, columns] = True
        left, top = self._scene.region[:2]
        centers, tolerance = (columns + left + 0.5, rows + top + 0.5), truth_tolerance(self._shading)
        steps = truth_steps(self._scene, self._name, *centers, tolerance, **self._shading)
        found = yield from announce(steps, begin, end, "Measuring the error at sample pixels")
        self.columns, self.rows = np.concatenate((self.columns, columns)), np.concatenate((self.rows, rows))
        self._random, self._true = np.concatenate((self._random, random)), np.concatenate((self._true, found))


def _spread(pixels: np.ndarray) -> np.ndarray:
    """Pixels (2, n) in random order, so that the first ones are from everywhere."""
    return pixels[:, np.random.default_rng(0).permutation(pixels.shape[1])]


def _free_of_meshes(scene: Scene, quality: Quality) -> np.ndarray:
    """(H, W) bool: pixels that no mesh changes."""
    left, top, right, bottom = scene.region
    if scene.triangles is None or len(scene.triangles) == 0:
        return np.ones((bottom - top, right - left), dtype=bool)
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    furthest = view.box_depths(scene.volume.shape_xyz, FOOTPRINTS[quality.kernel].radius)[1]
    reach = PIXELS_FROM_MESHES
    around = (
        max(left - reach, 0), max(top - reach, 0), min(right + reach, scene.width), min(bottom + reach, scene.height)
    )  # fmt: skip
    samples = mesh_depth(
        scene.triangles, scene.camera, scene.width, scene.height, region=around, threads=quality.threads,
    )  # fmt: skip
    ended = (samples < furthest).any(axis=-1)
    padded = np.pad(ended, reach)
    near = np.zeros_like(ended)
    for down in range(2 * reach + 1):
        for across in range(2 * reach + 1):
            near |= padded[down : down + ended.shape[0], across : across + ended.shape[1]]
    return ~near[top - around[1] : bottom - around[1], left - around[0] : right - around[0]]
