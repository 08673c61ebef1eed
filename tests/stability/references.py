"""Kernels held against their reference implementations, stage by stage and ray by ray, and what may set them apart.

Both splat each base plane from the same tables, and warp the same sheets, so that what differs is seen where it comes
from.  A ray may differ for one of a closed list of causes only, each of which is looked for in that ray:
``Splat.differences``.  Each cause has a case of its own in test_references.py.
"""

from __future__ import annotations

import inspect
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from unittest.mock import patch

import numpy as np

from rle_splat.encode.tables import RunLengthVolume
from rle_splat.pipeline.render import render_steps
from rle_splat.runtime.jit import use_reference
from rle_splat.runtime.steps import drain
from rle_splat.splat.scalar_splat import scalar_splat_steps, value_splat_steps
from rle_splat.splat.splat import OPAQUE, splat_steps
from rle_splat.warp.warp import warp_steps

SPLATS = {
    "rle_splat.pipeline.medium.splat_steps": splat_steps,
    "rle_splat.pipeline.medium.scalar_splat_steps": scalar_splat_steps,
    "rle_splat.pipeline.medium.value_splat_steps": value_splat_steps,
}
# No ray is known better than to this part of a voxel, and no value than to this part of the largest: shares of voxels
# are float32.
NUDGE = 2.0**-22
ROUNDING = 2.0**-20  # of color and transmittance: so much to begin with, and a sixteenth more for each sheet
END = 2.0**-20  # of the transmittance at which a ray ends, for each sheet
# A code's step, of the largest color and of the density itself, by the bytes of a record (encode/records.py).
STEPS = {8: (2.0**-11, 2.0**-11)}
ALMOST = 1e-4  # as good as the same, of what a moved ray shows


@dataclass(frozen=True)
class Differences:
    """How many rays differ by more than roundings between kernels and reference implementation: ``ends`` and ``edges``
    with a cause, ``odd`` without."""

    ends: int
    edges: int
    odd: int


@dataclass(eq=False)
class Splat:
    """One base plane's: what ``steps`` was ``given``, by name, and the ``image`` that it made.

    ``most``: largest channel of an unassociated color.  ``pixels``: of the image as it was made; a far layer's is
    filled in afterwards with rays that it was not given."""

    steps: object
    given: dict
    image: object
    most: float = 1.0
    pixels: np.ndarray = field(init=False)

    def __post_init__(self):
        self.pixels = self.image.pixels.copy()

    def by_reference(self, along=0.0, across=0.0, turn=0.0, grow=0.0) -> np.ndarray:
        """(H, W, 4) color and transmittance that the reference makes of it.

        ``along``, ``across``: voxels by which its rays are moved.  ``turn``: part of the largest number by which the
        values move that the lookup table begins and ends at.  ``grow``: share of itself that extinction gains."""
        plane, given = self.given["plane"], dict(self.given)
        given["plane"] = replace(plane, offset=plane.offset + np.array((along, across)) * plane.scale)
        if turn:
            given["table"] = _turned(given["encoded"], given["table"], turn)
        if grow:
            records = (given["encoded"].decoded() * (1.0 + grow)).astype(np.float32)
            given["encoded"] = replace(given["encoded"], voxel_data=records, decoding=None)
        with np.errstate(all="ignore"), use_reference():
            return drain(self.steps(**given)).pixels

    def differences(self) -> Differences:
        """Why rays of the reference implementation differ from the kernels'.

        An end: the transmittance was within its roundings of that at which rays end, so that one of the two went on;
        what it saw then is no more than that much of the brightest.  An edge: moved by NUDGE, looked up as far from its
        value, or through a medium that is denser by as much, the reference implementation's own ray changes by half the
        difference or more: each sheet may fall to its own side."""
        weight = 1.0 / np.array([max(self.most, 1.0)] * 3 + [1.0])
        kernels, reference = self.pixels, self.by_reference()
        apart = (abs(kernels.astype(np.float64) - reference) * weight).max(axis=-1)
        sheets = len(self.image.base_plane.sheets)
        odd = apart > ROUNDING * (1.0 + sheets / 16.0)
        least = max(self.given["quality"].termination, OPAQUE)
        ended = np.maximum(kernels[..., 3], reference[..., 3])
        end = odd & (ended < least) & (ended >= least * (1.0 - END * sheets)) & (apart <= least * (1.0 + ALMOST))
        odd &= ~end
        edge = np.zeros_like(odd)
        if odd.any():
            moved = [{"along": a * NUDGE, "across": b * NUDGE} for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]
            if self.steps is splat_steps:
                moved += [{"grow": NUDGE}, {"grow": -NUDGE}]
            elif self.steps is scalar_splat_steps:
                moved += [{"turn": side * NUDGE / part} for side in (-1, 1) for part in (1, 2, 4, 8)]
            among = [self.by_reference(**how) for how in moved]
            change = np.max([abs(image - reference) * weight for image in among], axis=(0, 3))
            edge = odd & (apart <= 2.0 * change + ALMOST)
            odd &= ~edge
        return Differences(int(end.sum()), int(edge.sum()), int(odd.sum()))


def _turned(encoded, table, turn: float):
    """A lookup table that is looked up a little beside the value."""
    ends = {name: getattr(table, name) for name in ("origin", "low", "high", "nearest", "furthest")}
    numbers = [*(end - encoded.center for end in ends.values()), *encoded.scalars.astype(np.float64)]
    most = max(abs(number) for number in numbers if abs(number) < 1e37)
    return replace(table, **{name: end + turn * most for name, end in ends.items()})


@contextmanager
def stages(splats: list, warps: list):
    """While it lasts, each Splat of what is rendered is kept, and each warp's images, other arguments and result."""

    def kept(steps):
        def splat(*arguments, **named):
            image = yield from steps(*arguments, **named)
            splats.append(Splat(steps, inspect.signature(steps).bind(*arguments, **named).arguments, image))
            return image

        return splat

    def warped(images, *rest):
        for one in splats:
            if any(one.image is image for image in images):
                one.most = float(rest[-1])
        made = yield from warp_steps(images, *rest)
        warps.append((images, rest, tuple(each.copy() for each in made)))  # pictures are mixed in place
        return made

    with ExitStack() as stack:
        for name, steps in SPLATS.items():
            stack.enter_context(patch(name, kept(steps)))
        stack.enter_context(patch("rle_splat.pipeline.render.warp_steps", warped))
        yield


def by_stages(scene, quality, kept=None):
    """(Rendering, Splats, warps) of a scene; see ``stages``."""
    splats, warps = [], []
    with stages(splats, warps), np.errstate(all="ignore"):
        made = drain(render_steps(scene, quality, cache=kept, refuse_empty_view=False))
    return made, splats, warps


def warps_apart(warps) -> float:
    """Largest difference of warped pictures of the same sheets, kernel and reference, color by the brightest."""
    worst = 0.0
    for images, (view, region, quality, most), (rgba, _) in warps:
        with use_reference():
            reference, _ = drain(warp_steps(images, view, region, quality, most))
        off = abs(rgba.astype(np.float64) - reference) / np.array([max(most, 1.0)] * 3 + [1.0])
        worst = max(worst, float(off.max(initial=0.0)))
    return worst


def tables_apart(one, two) -> tuple[int, float]:
    """Tables of two encodings that are not the same, and by how much their records are apart: in units of the largest,
    or, of codes, in steps."""
    scalar = not isinstance(one, RunLengthVolume)
    pair = (one.tables, two.tables) if scalar else (one, two)
    names = ("scanline_pointers", "scanline_data_pointers", "data_pointers", "runs")
    unlike = sum(not np.array_equal(*(getattr(each, name) for each in pair)) for name in names)
    if unlike:
        return unlike, np.inf
    if scalar:
        unlike += not np.array_equal(one.scalars, two.scalars)
        return unlike, max((_apart(*pair) for pair in zip(_codes(one), _codes(two), strict=True)), default=0.0)
    densities, colors = ([each.decoded()[:, part] for each in pair] for part in (slice(3, 4), slice(0, 3)))
    return unlike, max(_apart(*densities), _apart(*colors))


def _codes(encoded):
    """Normals, and what arrives and thins, of a ScalarVolume, in some unit."""
    return () if encoded.codes is None else (encoded.codes[:, :3], encoded.codes[:, 3:])


def _apart(one, two) -> float:
    most = float(np.abs(one).max(initial=0.0))
    return float(np.abs(one.astype(np.float64) - two).max(initial=0.0)) / most if most > 0.0 else 0.0
