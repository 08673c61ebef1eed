"""The table of systems: name -> System."""

from functools import partial

from ..scene import RleSplatError
from . import ihm_lee, laur_hanrahan, levoy, ours, totsuka_levoy, westover
from .system import System

SYSTEMS = {
    system.name: system
    for system in (
        System(
            "rle", "Run-length-encoded sheet-buffer splatting (ours)", "Zhang, Sun and Sun 2003, the paper",
            "The chosen quality.", ours.prepare,
        ),
        System(
            "paper", "The same, the paper to the letter", "Zhang, Sun and Sun 2003, the paper",
            "Opacities added in slice-plane sheets without correction for the length of the ray, one sheet pixel per "
            "voxel, bilinear warp.", ours.prepare_paper,
        ),
        System(
            "unaccelerated", "Sheet-buffer splatting of every voxel", "the paper's Table 2",
            "The same compiled loops, threads and termination as ours, on tables in which every voxel counts as "
            "non-transparent: no run is ever skipped.", ours.prepare_unaccelerated,
        ),
        System(
            "levoy", levoy.TITLE, "Levoy 1990, [3]",
            "Samples one voxel apart, trilinear, early termination, empty blocks leaped over; the medium is "
            "pre-classified, as in ours.", levoy.prepare,
        ),
        System(
            "westover-sheet", "Westover's splatting, sheet add", "Westover 1990, [6]",
            "Every voxel of the dense grid visited, footprints of the trilinear kernel added sheet by sheet on the "
            "screen; a ray's optical depth is exact but for the table's pixel grid.", westover.prepare,
        ),
        System(
            "westover-composite", "Westover's splatting, composite every sample", "Westover 1989, [5]",
            "As above, every footprint composited as it comes: overlapping kernels hide each other.",
            partial(westover.prepare, sheets=False),
        ),
        System(
            "lacroute", "Lacroute and Levoy's shear-warp", "Lacroute and Levoy 1994, [7]",
            "Slice planes, one sheet pixel per voxel, opacity resampled linearly within a slice and corrected for the "
            "length of the ray, a bilinear warp, termination at a transmittance of 0.05. The original keeps 8 bits a "
            "channel where we keep floats, looks shading up per frame, and has no perspective in its published "
            "program.", ours.prepare_shear_warp,
        ),
        System(
            "laur-hanrahan", "Laur and Hanrahan's hierarchical splatting", "Laur and Hanrahan 1991, [9]",
            f"Nodes of a pyramid whose error in a voxel's optical depth is at most {laur_hanrahan.THRESHOLD}, each "
            "with a footprint of its size, every sample composited.",
            laur_hanrahan.prepare,
        ),
        System(
            "ihm-lee", "Ihm and Lee's indexed splatting", "Ihm and Lee 1995, [10]",
            "Voxels of each slice sorted by density, so that bisection finds those of a changed window; drawn by our "
            "renderer.", ihm_lee.prepare,
        ),
        System(
            "totsuka-levoy", "Totsuka and Levoy's frequency domain X-ray", "Totsuka and Levoy 1993, [8]",
            "Absorption only: nothing hides anything, so only alpha is compared, and the color is the medium's mean. "
            "Without their directional shading and depth cueing.", totsuka_levoy.prepare, channels="a",
        ),
    )
}  # fmt: skip


def system_of(name: str) -> System:
    """The system ``name``; raises RleSplatError, with a list of the names, where there is none."""
    if name not in SYSTEMS:
        raise RleSplatError(f"There is no system called {name!r}; choose {', '.join(SYSTEMS)}.")
    return SYSTEMS[name]
