"""The catalogue of hard cases: what each id stands for, and what the tests measured of it.

``record`` is how a test says what it found: it holds the figure against the bound and keeps both for the table in
docs/explanation/stability.md, which ``dev.py test --catalogue`` writes.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

WIDTHS = ("float32", "float64")
EITHER = "either"  # a figure without an arithmetic width: whole numbers, sentences, bits that differ

CASES = {
    "V1": "all alpha = 0",
    "V2": "all alpha = 1",
    "V3": "alpha next to 1, at 2^-24 and denormal",
    "V4": "opacity correction",
    "V5": "phi(tau) = (1 - exp(-tau)) / tau",
    "V6": "NaN voxels",
    "V7": "infinite voxels",
    "V8": "constant volume",
    "V9": "data beyond the transfer function's ends",
    "V10": "transfer function with steps, duplicate, unsorted, single and no points",
    "V11": "transfer function whose range is a single value",
    "V12": "signed 16 bit, slope and intercept, unsigned wrap, big-endian, float64",
    "V13": "gradients of 8-bit noise",
    "V14": "colors above 1, negative emission",
    "V15": "extinction 1e-30 to 1e30",
    "S1": "decode(encode(v)) is v for random masks",
    "S2": "1xNxN, Nx1x1, one voxel, primes, no voxel",
    "S3": "checkerboard, the worst runs",
    "S4": "dimensions 65,535, 65,536 and 70,000",
    "S5": "more than 2^31 voxels and runs",
    "S6": "strided, Fortran-ordered, read-only, mapped and masked arrays",
    "S7": "corrupt run-length tables",
    "S8": "the three axes' encodings",
    "R1": "raw files and their options, fuzzed",
    "R2": "transfer function, camera and lights files, fuzzed",
    "R3": ".rle files cut, flipped and lying about their sizes",
    "R4": "OpenVDB files cut and flipped",
    "C1": "view along an axis, a diagonal, a tie at 45 degrees",
    "C2": "rotation by 1e-1 to 1e-12 rad",
    "C3": "a full turn in steps of 1 degree",
    "C4": "translation by whole pixels and voxels",
    "C5": "volume and camera moved together",
    "C6": "quarter turns, axis permutations, mirrors",
    "C7": "everything scaled by 1e-12 to 1e12",
    "C8": "anisotropy 1:1000 and 1000:1",
    "C9": "sheared and mirrored matrices",
    "C10": "singular and nearly singular matrices",
    "C11": "camera outside, on the face, at a voxel, inside, behind",
    "C12": "a slice through the eye, voxels behind the eye",
    "C13": "clip planes inside the volume",
    "C14": "focal length towards infinity",
    "C15": "field of view 170 degrees, lens shift 5, pixel aspect 1:2",
    "C16": "grazing rays",
    "C17": "pictures 1x1, 1xN, 16k x 16k, crops",
    "C18": "world coordinates of 1e7",
    "A1": "1e3 to 1e7 thin sheets",
    "A2": "transmittance underflow",
    "A3": "early termination",
    "A4": "order inside a sheet",
    "A5": "threads and bands",
    "A6": "over is associative",
    "A7": "energy, white furnace",
    "A8": "monotonicity",
    "A9": "premultiplied bound",
    "A10": "partition of unity",
    "A11": "resolution refinement",
    "A12": "run to run, process to process, cold and warm kernel cache",
    "A13": "FMA, another CPU",
    "A14": "two lights, none, one at a voxel, one inside",
    "A15": "cancelled, rendered again, transfer function changed half-way",
    "P1": "any scene and any plan, fuzzed",
    "P2": "the sheets of any medium, fuzzed",
    "P3": "pictures of smooth media, fuzzed",
    "P4": "any effects at once, fuzzed",
    "K1": "rays on the step where a footprint ends",
    "K2": "numbers on the middle between two codes of a short record",
    "K3": "a ray that ends a sheet sooner",
    "K4": "a ray that touches the end of a medium dense beyond measure",
    "K5": "a value on the edge of an entry of the table",
    "K6": "opacities of one over a small part of their length",
    "K7": "rays past a silhouette that end as those before it",
    "P5": "any edits of a scene with a stage cache, searched",
    "F1": "renders at once from several threads",
    "F3": "a full disk, a folder that cannot be written",
    "F4": "a kernel cache corrupted on purpose",
    "F5": "memory limited by the system",
    "F6": "a parallel call within another",
}


class Catalogue:
    """What one session of tests measured.  ``rows``: (id, claim) -> the row of the table, worst figures kept."""

    def __init__(self):
        self.rows: dict[tuple[str, str], dict] = {}

    def record(
        self, case: str, claim: str, measured, bound, width: str = "float32", why: str = "", looser: str = ""
    ) -> None:
        """Assert ``measured`` <= ``bound`` and keep both.

        ``claim``: what is bounded, with its unit ("relative error of phi, tau in [0, 100]").
        ``width``: "float32" or "float64", the arithmetic that ``measured`` comes from; "either" where none applies.
        ``why``: what the table says for a width that ``claim`` is never measured in; for "either" it is a must, and for
        a claim measured in float32 alone it may be left out where the width of the sums is not its matter.
        ``looser``: the measured reason, where ``bound`` is looser than the catalogue's.
        Recorded again under the same claim, the largest figure counts.
        """
        assert case in CASES, f"{case} has no name; give it one in CASES"
        assert width in (*WIDTHS, EITHER) and (why or width != EITHER), "say which width, or why none applies"
        measured, bound = float(measured) + 0.0, float(bound)  # no minus zeros
        row = self.rows.setdefault((case, claim), {"bound": bound, "figures": {}, "why": why, "looser": looser})
        assert (row["bound"], row["why"], row["looser"]) == (bound, why, looser), f"two bounds for {case}: {claim}"
        worst = row["figures"].get(width, -math.inf)
        row["figures"][width] = measured if math.isnan(measured) else max(worst, measured)
        assert measured <= bound, f"{case}: {claim}: {measured:.6g} where {bound:.6g} is the most"

    def save(self, path) -> None:
        rows = [{"id": case, "case": CASES[case], "claim": claim, **row} for (case, claim), row in self.rows.items()]
        order = list(CASES)
        rows.sort(key=lambda row: order.index(row["id"]))
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_text(json.dumps({"cases": CASES, "rows": rows}, indent=1), encoding="utf-8")


def ids_in(test_name: str) -> set[str]:
    """The catalogue's ids in a test's name: test_V4_opacity_correction -> {"V4"}."""
    return {part for part in re.split(r"[_\[]", test_name) if part in CASES}
