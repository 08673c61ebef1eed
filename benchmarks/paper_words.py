"""The tables of bench paper as text, and an explanation of each speedup."""

from __future__ import annotations

from rle_splat.scene import RECORDS
from rle_splat.splat.pixel_block import BLOCK

from . import records

PAPER_RECORD = 16  # bytes per record, float RGBA, as the paper's Table 1 implies
BEYOND = 1.2  # tolerance on 1/p, because the paper's figures are rounded and its p is inferred
MB = 1 << 20  # as in the paper, where 256 x 256 x 256 bytes are 16.0 MB


def table_1(rows) -> list[str]:
    """The lines of Table 1, memory for three principal axes; ``rows``: (DataSet, measured) pairs."""
    lines = [
        "Table 1. Memory of the run-length tables, three principal axes, MB (2^20 bytes); in brackets ours / paper",
        f"{'data set':<24}{'paper: size':>13}{'MB':>7}   {'ours: size':>13}{'p':>7}{'1/p':>7}"
        + "".join(f"{f'{record} bytes a record':>20}" for record in RECORDS),
    ]
    for data, row in rows:
        size = "x".join(map(str, row["shape_xyz"]))
        line = (
            f"{row['called']:<24}{data.resolution:>13}{data.paper_mb:7.1f}   {size:>13}{row['kept_fraction']:7.1%}"
            f"{row['bound']:7.1f}"
        )
        for record in RECORDS:
            ours = row["memory_bytes"][record]["total"] / MB
            line += f"{f'{ours:.1f} ({ours / data.paper_mb:.2f})':>20}"
        lines.append(line)
    lines.append(f"The paper's figures correspond to {PAPER_RECORD} bytes per record: four floats.")
    return lines


def record_errors(rows, quality: str) -> list[str]:
    """The lines on the errors of the record sizes, see ``records.compare_records``."""
    return [
        "Table 1, errors of the records in levels, against the picture of 16 bytes and against T1; and their time",
        records.header(),
        *(records.line(row["called"], quality, row["record_errors"]) for _, row in rows),
    ]


def table_2(rows) -> list[str]:
    """The lines of Table 2: splatting with and without run lengths, and Westover's splatting of the same medium."""
    lines = [
        "Table 2. Splatting without and with run lengths; the paper's in seconds, ours in milliseconds",
        f"{'':<24}{'paper':>25}   {'ours: splat alone':>28}{'':>14}   {'splat + warp':>21}   {'Westover':>31}",
        f"{'data set':<24}{'without':>9}{'with':>8}{'x':>8}   {'without':>11}{'with':>9}{'x':>8}{'1/p':>7}"
        f"{'x, T':>7}   {'without':>9}{'with':>7}{'x':>5}   {'all':>9}{'visible':>9}{'x':>7}{'x':>6}",
    ]
    for data, row in rows:
        without, with_ = data.paper_seconds
        line = (
            f"{row['called']:<24}{without:9.2f}{with_:8.2f}{data.paper_speedup:8.1f}   {row['all_splat_ms']:11.1f}"
            f"{row['rle_splat_ms']:9.1f}{row['splat_speedup']:8.1f}{row['bound']:7.1f}"
            f"{row['unlimited_splat_speedup']:7.1f}   {row['all_ms']:9.1f}{row['rle_ms']:7.1f}{row['speedup']:5.1f}"
        )
        if "westover_all_ms" in row:
            line += f"   {row['westover_all_ms']:9.0f}{row['westover_visible_ms']:9.0f}"
            line += f"{row['westover_all_ms'] / row['rle_ms']:7.1f}{row['westover_visible_ms'] / row['rle_ms']:6.1f}"
        lines.append(line)
    lines += [
        "x: time without over time with run lengths, the median over the views; 'x, T': the same without early "
        "termination.",
        "Westover: footprint tables, of all voxels (all) or of visible voxels (visible); x: its time over our "
        "splat + warp.",
    ]
    return lines


def explain(data, row) -> list[str]:
    """Sentences that explain the speedup of one data set."""
    speedup, bound, paper = row["splat_speedup"], row["bound"], data.paper_speedup
    words = [f"{row['called']}: {speedup:.1f}x here, {paper:g}x in the paper; 1/p = {bound:.1f} here."]
    if data.caveat and row["called"] == data.name:
        words.append(f"The scan differs: {data.caveat}.")
    implied = data.paper_mb / (3 * PAPER_RECORD * data.paper_volume_mb)
    words.append(
        f"The paper's Table 1, at {PAPER_RECORD} bytes per record, implies a p of {implied:.1%} and a bound of "
        f"{1.0 / implied:.1f}."
    )
    if paper > BEYOND / implied:
        words.append(
            f"Its speedup exceeds that bound, so something else slowed its baseline too: at {PAPER_RECORD} bytes each "
            f"its voxels fill {PAPER_RECORD * data.paper_volume_mb:.0f} MB of its machine's 256 MB."
        )
    if speedup < paper:
        words.append(_why(row))
    return [" ".join(words)]


def _why(row) -> str:
    """Why the speedup is below 1 / p: the pixels composited per kept voxel, and early termination."""
    spared_rle = 1.0 - row["rle_splat_ms"] / row["rle_splat_unlimited_ms"]
    spared_all = 1.0 - row["all_splat_ms"] / row["all_splat_unlimited_ms"]
    covered = row["covered_fractions"]
    per_voxel = 1e6 * row["all_splat_unlimited_ms"] / row["voxels"]
    per_kept = 1e6 * row["rle_splat_unlimited_ms"] / max(row["kept_voxels"], 1)
    return (
        f"The footprints of the {row['kept_fraction']:.1%} kept voxels cover {covered['pixels']:.1%} of the sheet "
        f"pixels, a bound of {1.0 / covered['pixels']:.1f}. Both sides composite blocks of {BLOCK} pixels; the "
        f"footprints touch {covered['blocks']:.1%} of the blocks, a bound of {1.0 / covered['blocks']:.1f}. Without "
        f"early termination a voxel of the baseline takes {per_voxel:.1f} ns and a kept voxel of ours "
        f"{per_kept:.1f} ns, including scanline pointers and runs. Early termination saves {spared_all:.0%} of the "
        f"baseline's time and {spared_rle:.0%} of ours; without it the ratio is "
        f"{row['unlimited_splat_speedup']:.1f}. The last columns compare with Westover's splatting, which the paper's "
        "baseline more likely was."
    )
