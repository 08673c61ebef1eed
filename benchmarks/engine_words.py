"""The table of bench engine as text, for the screen and for the page, with a summary of the ratios to the peers."""

from __future__ import annotations

from statistics import median

from .frames import describe
from .peers import PEERS

COLUMNS = (
    ("whole", "whole_ms"), ("frame", "frame_ms"), ("splat", "splat_ms"), ("warp", "warp_ms"), ("rays", "rays_ms"),
    ("encode", "encode_ms"), ("shade", "shade_ms"),
)  # fmt: skip
TRUTHS = ("t1", "t2")
NOTES = """
whole = the whole call for a moved camera, measured from outside; ratios are of these. frame = splat + warp + rays of
it. VTK: vtkFixedPointVolumeRayCastMapper, one or four samples per voxel; its frame is its whole. It gives voxels
without a gradient only ambient light, so with shading its time is compared but not its error. VolPack: its frame
is vpRenderClassifiedVolume, always on one thread, 8 bits; its whole has the table of lit colors, too; encode is
vpClassifyVolume, three axes. "VolPack" uses the thresholds that its manual suggests: voxels of opacity 0.05 or less are
skipped, pixels end at 0.95. "VolPack, all" keeps all voxels and ends pixels where paper-like does. It supports parallel
rays only."""


def header() -> str:
    """The table's first line."""
    return (
        f"{'volume':<12}{'p':>6}  {'projection':<13}{'colors':<10}{'quality':<13}{'classified':<11}"
        + "".join(f"{title:>8}" for title, _ in COLUMNS)
        + f"   {'T1 RMSE':>8}{'max':>7}{'T2 RMSE':>9}{'max':>7}  "
        + "".join(_titles().values())
    )


def _titles() -> dict[str, str]:
    return {peer: f"  {f'ours/{peer}':>9}" for peer in PEERS}


def line(name: str, row: dict) -> str:
    """One row of the table: one of our qualities, or a peer."""

    def cell(value, width, digits=1):
        return f"{'-':>{width}}" if value is None else f"{value:{width}.{digits}f}"

    def errors(found, width):
        found = found or {"rmse": None, "largest": None}
        return cell(found["rmse"], width, 2) + cell(found["largest"], 7)

    def ratio(value, width):
        return f"{value:>{width}}" if isinstance(value, str) else cell(value, width, 2)

    kept = f"{'-':>6}" if row["kept_fraction"] is None else f"{row['kept_fraction']:6.1%}"
    return (
        f"{name:<12}{kept}  {_projection(row):<13}{_colors(row):<10}{row['quality']:<13}{row['classification']:<11}"
        + "".join(cell(row[key], 8) for _, key in COLUMNS)
        + f"   {errors(row['t1'], 8)}{errors(row['t2'], 9)}  "
        + "".join(ratio(row["against"].get(peer, "" if row["peer"] else None), len(title))
                  for peer, title in _titles().items())
    )  # fmt: skip


def _projection(row) -> str:
    return "perspective" if row["perspective"] else "orthographic"


def _colors(row) -> str:
    return "shaded" if row["shaded"] else "unshaded"


def _groups(table) -> dict[tuple, dict[str, dict]]:
    """(name, size, threads) -> quality or peer -> row."""
    groups: dict = {}
    for row in table:
        name = ", ".join((row["volume"], _projection(row), _colors(row)))
        groups.setdefault((name, row["size"], row["threads"]), {})[row["quality"]] = row
    return groups


def ratios(table) -> list[str]:
    """One line per quality and peer: ratio of our time and RMSE to theirs, median and range over the run."""
    found: dict = {}
    for rows in _groups(table).values():
        for quality, row in rows.items():
            for peer, times in row["against"].items():
                if isinstance(times, str):
                    continue
                collected = found.setdefault((quality, peer), {"time": [], "t1": [], "t2": []})
                collected["time"].append(times)
                for truth in TRUTHS:
                    if row[truth] and rows[peer][truth]:
                        collected[truth].append(row[truth]["rmse"] / rows[peer][truth]["rmse"])
    lines = []
    for (quality, peer), collected in found.items():
        said = [
            f"{title} {median(values):.2f} ({min(values):.2f} to {max(values):.2f})"
            for title, values in zip(("time", "T1 RMSE", "T2 RMSE"), collected.values()) if values
        ]  # fmt: skip
        lines.append(f"{quality} / {peer}: {', '.join(said)}")
    return lines


def markdown(table, where: dict) -> str:
    """Times, errors and ratios of a run for the page, one line per volume, projection and shading."""
    qualities = list(dict.fromkeys(row["quality"] for row in table if not row["peer"]))
    peers = list(dict.fromkeys(row["quality"] for row in table if row["peer"]))
    first = ("", "p", "px", "threads")
    wholes = _lines(table, (*first, *qualities, *peers), lambda rows: [
        *(_ours(rows.get(quality)) for quality in qualities),
        *(f"{rows[peer]['whole_ms']:.1f}" if peer in rows else "-" for peer in peers),
    ])  # fmt: skip
    times = _lines(table, (*first, *qualities, *peers, "encode"), lambda rows: [
        *(f"{rows[name]['frame_ms']:.1f}" if name in rows else "-" for name in (*qualities, *peers)),
        ", ".join(dict.fromkeys(f"{row['encode_ms']:.1f}" for row in rows.values() if not row["peer"])),
    ])  # fmt: skip
    errors = _lines(table, (*first, *qualities, *peers), lambda rows: [
        " / ".join("-" if name not in rows or not rows[name][truth] else f"{rows[name][truth]['rmse']:.2f}"
                   for truth in TRUTHS)
        for name in (*qualities, *peers)
    ])  # fmt: skip
    busy = f"{describe(where)} Others kept {where['others_busy_cores'] or 0.0:.2f} cores busy."
    parts = [
        "The whole call, milliseconds, with the ratio to each peer's in brackets:", "\n".join(wholes),
        "Splat, warp and single rays of it, milliseconds, and encode:", "\n".join(times),
        "RMSE, in 8-bit steps, against T1 / T2:", "\n".join(errors),
    ]  # fmt: skip
    compared = ratios(table)
    if compared:
        parts += ["Ours over theirs, median and range of this run:", "\n".join(f"- {text}" for text in compared)]
    return "\n\n".join((*parts, busy))


def _ours(row) -> str:
    """Milliseconds of the whole call, with the ratio to each peer in brackets."""
    if row is None:
        return "-"
    over = [f"{value:.2f}" for value in row["against"].values() if not isinstance(value, str)]
    return f"{row['whole_ms']:.1f}" + (f" ({', '.join(over)})" if over else "")


def _lines(table, heads, cells_of) -> list[str]:
    """The lines of a Markdown table."""
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for (name, size, threads), rows in _groups(table).items():
        kept = next((row["kept_fraction"] for row in rows.values() if not row["peer"]), None)
        share = "-" if kept is None else f"{kept:.1%}"
        lines.append(f"| {' | '.join((name, share, str(size), str(threads), *cells_of(rows)))} |")
    return lines
