"""The plots in docs/images.  matplotlib is installed only in the benchmarks' environment."""

from __future__ import annotations

from pathlib import Path

try:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    PLOT_PROBLEM = ""
except ImportError as problem:
    plt = None
    PLOT_PROBLEM = str(problem)

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
DOTS_PER_INCH = 110
COLORS = {"scaled": "tab:blue", "boxed": "tab:orange"}


def _save(figure, path: Path) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.tight_layout()
    figure.savefig(path, dpi=DOTS_PER_INCH)
    plt.close(figure)
    return f"Wrote {path}"


def scaling_plot(rows, path: Path, most_bytes: int) -> str:
    """Plot time against kept voxels and against volume size, and peak memory with the allowed one; a sentence on it."""
    if plt is None:
        return f"No plot: matplotlib is not here ({PLOT_PROBLEM})."
    figure, (by_kept, by_volume, memory) = plt.subplots(1, 3, figsize=(15, 6))
    for series, color in COLORS.items():
        mine = [row for row in rows if row["series"] == series]
        kept, volume = [row["kept_voxels"] for row in mine], [row["volume_bytes"] for row in mine]
        for name, style in (("frame", "o-"), ("encode", "s--"), ("classify", "^:")):
            spent = [row[f"{name}_ms"] for row in mine]
            by_volume.loglog(volume, spent, style, color=color, label=f"{name}, {series}")
            if name != "classify":  # its time depends on all voxels
                by_kept.loglog(kept, spent, style, color=color, label=f"{name}, {series}")
        for name, style, label in (
            ("three_axes_peak_bytes", "D-", "peak, three axes"), ("peak_bytes", "o-", "peak, one axis and frames"),
            ("three_axes_bytes", "s--", "tables of three axes"),
        ):  # fmt: skip
            if all(row[name] for row in mine):
                size = [row[name] / 2**30 for row in mine]
                memory.loglog(volume, size, style, color=color, label=f"{label}, {series}", alpha=0.8)
    most = max(rows, key=lambda row: row["kept_voxels"])
    ends = [min(row["kept_voxels"] for row in rows), most["kept_voxels"]]
    proportional = [most["frame_ms"] * kept / most["kept_voxels"] for kept in ends]
    by_kept.loglog(ends, proportional, ":", color="gray", label="in proportion to the kept voxels")
    sides = {row["n"]: row["volume_bytes"] for row in rows}
    volume = sorted(sides.values())
    memory.loglog(volume, [size / 2**30 for size in volume], ":", color="gray", label="the volume itself")
    memory.axhline(most_bytes / 2**30, color="tab:red", lw=1, label=f"{most_bytes >> 30} GiB")
    by_kept.set(xlabel="kept voxels", ylabel="milliseconds", title="Time grows with the kept voxels ...")
    by_volume.set(xlabel="voxels of the volume", ylabel="milliseconds", title="... not with the volume")
    memory.set(xlabel="voxels of the volume", ylabel="GiB", title="Memory")
    for axes in (by_volume, memory):
        axes.set_xticks(list(sides.values()), [f"{side}³" for side in sides])
        axes.minorticks_off()
    for axes in (by_kept, by_volume, memory):
        axes.grid(True, which="major", alpha=0.3)
        axes.legend(fontsize=8, ncol=2, loc="upper center", bbox_to_anchor=(0.5, -0.13))
    return _save(figure, path)


def turn_plot(turn, near, path: Path) -> str:
    """Plot the difference of frames and alpha over a full turn, and of two axes near the switch; a sentence on it."""
    if plt is None:
        return f"No plot: matplotlib is not here ({PLOT_PROBLEM})."
    figure, (steps, alpha, both) = plt.subplots(3, 1, figsize=(11, 9))
    angle = [row["azimuth"] for row in turn]
    steps.plot(angle, [row["largest"] for row in turn], color="tab:red", lw=1, label="largest")
    steps.plot(angle, [row["rmse"] for row in turn], color="tab:blue", lw=1, label="RMSE")
    steps.set(ylabel="levels", title="Difference from the frame one step before", yscale="log")
    mean = sum(row["alpha"] for row in turn) / len(turn)
    alpha.plot(angle, [100.0 * (row["alpha"] / mean - 1.0) for row in turn], color="tab:green", lw=1)
    alpha.set(xlabel="azimuth, degrees", ylabel="percent", title="Alpha summed over the picture, against its mean")
    for axes in (steps, alpha):
        for row in turn:
            if row["switched"]:
                axes.axvline(row["azimuth"], color="gray", ls=":", lw=1)
        axes.set_xlim(min(angle), max(angle))
    for key, label in (
        ("largest", "largest, rgba"), ("rmse", "RMSE, rgba"), ("alpha_largest", "largest, alpha"),
        ("true_largest", "from the reference, chosen axis"), ("other_largest", "from the reference, other axis"),
        ("step_faded", "a quarter of a degree on"), ("step_switched", "the same with a switch"),
    ):  # fmt: skip
        values = [row[key] for row in near]
        if None not in values:
            both.plot([row["azimuth"] for row in near], values, "o-", ms=3, label=label)
    both.set(xlabel="azimuth, degrees", ylabel="levels", title="The same frame from both principal axes, at the switch")
    for axes in (steps, alpha, both):
        axes.grid(True, alpha=0.3)
    steps.legend()
    both.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))
    return _save(figure, path)
