"""The two tables as text, and in words why a speed-up is what it is."""

from __future__ import annotations

MB = 1 << 20  # the paper's: 256 x 256 x 256 bytes are its 16.0 MB


def table_1(rows) -> list[str]:
    """Table 1: memory of the tables for all three principal axes; ``rows``: (DataSet, measured) pairs."""
    lines = [
        "Table 1. Memory of the run-length tables, three principal axes, MB (2^20 bytes)",
        f"{'data set':<24}{'paper: size':>13}{'MB':>7}   {'ours: size':>13}{'p':>7}{'MB at 16 B':>12}"
        f"{'B/record':>10}{'MB':>7}{'ours/paper':>12}",
    ]
    for data, row in rows:
        size = "x".join(map(str, row["shape_xyz"]))
        own = row["memory_bytes"]["total"] / MB
        lines.append(
            f"{row['called']:<24}{data.resolution:>13}{data.paper_mb:7.1f}   {size:>13}{row['kept_fraction']:7.1%}"
            f"{row['paper_record_memory_bytes'] / MB:12.1f}{row['record_bytes']:10.1f}{own:7.1f}"
            f"{own / data.paper_mb:12.2f}"
        )
    return lines


def table_2(rows) -> list[str]:
    """Table 2: splatting with and without run lengths, and Westover's splatting of the same medium."""
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
        "x: without against with, the median of the views' ratios; 'x, T': the same with early termination off on "
        "both sides.",
        "Westover: footprint tables, every voxel (all) or every non-transparent voxel (visible); x against our "
        "splat + warp, which has its picture as well.",
    ]
    return lines


def explain(data, row) -> list[str]:
    """Sentences on one data set's speed-up, with the numbers they rest on."""
    speedup, bound, paper = row["splat_speedup"], row["bound"], data.paper_speedup
    words = [f"{row['called']}: {speedup:.1f}x here, {paper:g}x in the paper; 1/p = {bound:.1f}."]
    if data.caveat and row["called"] == data.name:
        words.append(f"The scan differs: {data.caveat}.")
    if paper > bound:
        words.append(
            "The paper's figure is beyond 1/p at our p, so skipping voxels cannot explain it: either its transfer "
            "function kept less, or its baseline suffered from more than the voxels (four floats a voxel of a 256^3 "
            "volume fill its machine's 256 MB)."
        )
    if speedup < paper:
        spared_rle = 1.0 - row["rle_splat_ms"] / row["rle_splat_unlimited_ms"]
        spared_all = 1.0 - row["all_splat_ms"] / row["all_splat_unlimited_ms"]
        covered = row["covered_fraction"]
        words.append(
            f"Termination spares the baseline {spared_all:.0%} of its time and ours {spared_rle:.0%}; without it the "
            f"ratio is {row['unlimited_splat_speedup']:.1f}. The footprints of the kept {row['kept_fraction']:.1%} of "
            f"the voxels reach {covered:.1%} of the sheets' pixels, a bound of {1.0 / covered:.1f} on compositing; "
            f"the walk through scanline pointers and runs is paid on top, whatever p is, against a baseline of "
            f"{1e6 * row['all_splat_unlimited_ms'] / row['voxels']:.1f} ns a voxel."
        )
    return [" ".join(words)]
