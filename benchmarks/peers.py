"""The programs that bench engine compares with, in the same run and on the same scenes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from .volpack_caster import ALL_VOXELS, PACKAGE, SUGGESTED, VOLPACK_PROBLEM, VolpackCaster
from .vtk_caster import VTK_PROBLEM, VtkCaster

NOT_HERE, NOT_THERE = "not here", "not there"  # not installed here; not supported by the program


@dataclass(frozen=True)
class Peer:
    """A program to compare with."""

    name: str
    classification: str  # "pre" or "post"
    make: Callable  # make(scene, shaded, threads) has ``draw``, ``close`` and, for "pre", ``classify_ms``
    problem: str  # why it is not installed; "" if it is
    remedy: str  # the command that installs it
    perspective: bool = True  # whether it can
    same_colors: bool = True  # whether its shading is ours, so that shaded pictures can be compared with our truths

    def absence(self, perspective: bool) -> str:
        """The text in its columns if it cannot be measured; "" if it can."""
        if self.problem:
            return NOT_HERE
        return NOT_THERE if perspective and not self.perspective else ""


def _volpack(thresholds, scene, shaded, threads):
    return VolpackCaster(scene, shaded, thresholds)  # always on one thread


_VOLPACK = dict(
    classification="pre", problem=VOLPACK_PROBLEM, remedy=f"apt install {PACKAGE}", perspective=False,
)  # fmt: skip
_VTK = dict(classification="post", problem=VTK_PROBLEM, remedy="pip install vtk", same_colors=False)
DENSE, SAMPLES = "VTK, x4", 4  # as many samples per voxel as strict has sheets per slice
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
