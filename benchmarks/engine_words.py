"""The engine's table as text: on the screen, and for the page; and in a few lines how ours compare with the peers."""

from __future__ import annotations

from statistics import median

from .frames import describe
from .peers import PEERS

COLUMNS = (
    ("frame", "frame_ms"), ("splat", "splat_ms"), ("warp", "warp_ms"), ("rays", "rays_ms"), ("encode", "encode_ms"),
    ("shade", "shade_ms"),
)  # fmt: skip
TRUTHS = ("t1", "t2")
NOTES = """
frame = splat + warp + rays. VTK: vtkFixedPointVolumeRayCastMapper, one sample a voxel, or four, rays only. It shades
what has no gradient by ambient light alone, so shaded, it is compared in time and not in error. VolPack:
vpRenderClassifiedVolume, on one thread whatever ours have, 8 bits; encode is vpClassifyVolume, three axes. By itself
with the thresholds that its manual suggests: no voxel of opacity 0.05 or less, no more for a pixel of 0.95. "VolPack,
all" has all voxels, and pixels are closed where paper-like closes them. It has parallel rays only."""


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
    """One row of the table: a quality of ours, or a peer."""

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
    """The rows by what they show and how, then by quality or peer."""
    groups: dict = {}
    for row in table:
        name = ", ".join((row["volume"], _projection(row), _colors(row)))
        groups.setdefault((name, row["size"], row["threads"]), {})[row["quality"]] = row
    return groups


def ratios(table) -> list[str]:
    """One line for each quality and peer: ours over theirs, in time and in RMSE, the median and the range of a run."""
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
    """Times, errors and ratios of a run, for the page: a line for each volume, projection and colors."""
    qualities = list(dict.fromkeys(row["quality"] for row in table if not row["peer"]))
    peers = list(dict.fromkeys(row["quality"] for row in table if row["peer"]))
    first = ("", "p", "px", "threads")
    times = _lines(table, (*first, *qualities, *peers, "encode"), lambda rows: [
        *(_ours(rows.get(quality)) for quality in qualities),
        *(f"{rows[peer]['frame_ms']:.1f}" if peer in rows else "-" for peer in peers),
        ", ".join(dict.fromkeys(f"{row['encode_ms']:.1f}" for row in rows.values() if not row["peer"])),
    ])  # fmt: skip
    errors = _lines(table, (*first, *qualities, *peers), lambda rows: [
        " / ".join("-" if name not in rows or not rows[name][truth] else f"{rows[name][truth]['rmse']:.2f}"
                   for truth in TRUTHS)
        for name in (*qualities, *peers)
    ])  # fmt: skip
    busy = f"{describe(where)} Others kept {where['others_busy_cores'] or 0.0:.2f} cores busy."
    parts = ["\n".join(times), "RMSE, levels, against T1 / T2:", "\n".join(errors)]
    compared = ratios(table)
    if compared:
        parts += ["Ours over theirs, median and range of this run:", "\n".join(f"- {text}" for text in compared)]
    return "\n\n".join((*parts, busy))


def _ours(row) -> str:
    """A frame's milliseconds, in brackets over each peer's."""
    if row is None:
        return "-"
    over = [f"{value:.2f}" for value in row["against"].values() if not isinstance(value, str)]
    return f"{row['frame_ms']:.1f}" + (f" ({', '.join(over)})" if over else "")


def _lines(table, heads, cells_of) -> list[str]:
    """The lines of a table, heads first."""
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for (name, size, threads), rows in _groups(table).items():
        kept = next((row["kept_fraction"] for row in rows.values() if not row["peer"]), None)
        share = "-" if kept is None else f"{kept:.1%}"
        lines.append(f"| {' | '.join((name, share, str(size), str(threads), *cells_of(rows)))} |")
    return lines
