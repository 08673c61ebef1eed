"""What every named system is: a name, where it comes from, and two verbs, prepare and draw."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..runtime.jit import NUMBA_PROBLEM, compiled
from ..scene import NO_DEPTH, Quality, Rendering, RleSplatError
from .medium import Medium


@dataclass(frozen=True, eq=False)
class Prepared:
    """A system that has done what does not depend on the frame.

    ``draw``: () -> Rendering, one frame.  ``memory_bytes``: bytes by name of what a frame is drawn from.
    ``notes``: JSON-ready facts that only this system has.
    """

    draw: Callable[[], Rendering]
    memory_bytes: dict
    notes: dict = field(default_factory=dict)

    @property
    def total_bytes(self) -> int:
        return sum(self.memory_bytes.values())


@dataclass(frozen=True)
class System:
    """One entry of the table of systems.

    ``reference``: the publication, with its number in the paper where the paper cites it.  ``differs``: what sets
    it apart, from ours and from its original, in words.  ``judged``: the channels in which its picture claims to
    be T1's: "rgba", or "a" for one without occlusion.
    """

    name: str
    title: str
    reference: str
    differs: str
    prepare: Callable[[Medium, Quality], Prepared]
    judged: str = "rgba"


def need_kernels(quality: Quality, title: str) -> None:
    """Refuse the numpy backend for a system that exists as compiled kernels only."""
    if not compiled(quality.backend):
        reason = f" ({NUMBA_PROBLEM})" if NUMBA_PROBLEM else ""
        raise RleSplatError(f"{title} needs numba{reason}; install it or leave --backend numpy out.")


def picture(transmittance_image: np.ndarray, depth: np.ndarray | None = None, **report) -> Rendering:
    """A Rendering from (H, W, 4) premultiplied colour and *transmittance*; no depth unless it is given."""
    rgba = np.ascontiguousarray(transmittance_image, dtype=np.float32)
    rgba[..., 3] = 1.0 - rgba[..., 3]
    if depth is None:
        depth = np.full(rgba.shape[:2], NO_DEPTH, np.float32)
    return Rendering(rgba, depth, report)
