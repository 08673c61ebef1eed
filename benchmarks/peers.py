"""The programs that bench engine holds ours against, in the same run and on the same scenes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from .volpack_caster import ALL_VOXELS, PACKAGE, SUGGESTED, VOLPACK_PROBLEM, VolpackCaster
from .vtk_caster import VTK_PROBLEM, VtkCaster

NOT_HERE, NOT_THERE = "not here", "not there"  # the program, on this machine; what is asked for, in the program


@dataclass(frozen=True)
class Peer:
    """``make``: (scene, shaded, threads) -> an object with draw, close and, where it classifies first, classify_ms.

    ``classification``: the order of classifying and interpolating, as ours are called.  ``problem``: why it is not on
    this machine; empty where it is.  ``remedy``: what brings it.  ``same_colors``: whether its shading is ours, so that
    its shaded pictures can be held against our truths.
    """

    name: str
    classification: str
    make: Callable
    problem: str
    remedy: str
    perspective: bool = True
    same_colors: bool = True

    def absence(self, perspective: bool) -> str:
        """What stands in its columns in place of figures; empty where it has figures."""
        if self.problem:
            return NOT_HERE
        return NOT_THERE if perspective and not self.perspective else ""


def _volpack(thresholds, scene, shaded, threads):
    return VolpackCaster(scene, shaded, thresholds)  # always on one thread


_VOLPACK = dict(
    classification="pre", problem=VOLPACK_PROBLEM, remedy=f"apt install {PACKAGE}", perspective=False,
)  # fmt: skip
_VTK = dict(classification="post", problem=VTK_PROBLEM, remedy="pip install vtk", same_colors=False)
DENSE, SAMPLES = "VTK, x4", 4  # as many samples of a voxel's depth as strict has sheets
ALL = "VolPack, all"
PEERS = {
    peer.name: peer
    for peer in (
        Peer("VTK", make=VtkCaster, **_VTK),
        Peer(DENSE, make=partial(VtkCaster, samples=SAMPLES), **_VTK),
        Peer("VolPack", make=partial(_volpack, SUGGESTED), **_VOLPACK),
        Peer(ALL, make=partial(_volpack, ALL_VOXELS), **_VOLPACK),
    )
}
