"""The plot of time against error.  matplotlib is never part of the extension: it is used where it is installed."""

from __future__ import annotations

from importlib.util import find_spec
from itertools import pairwise

import numpy as np

from ..accuracy.metrics import ERRORS, LEVEL, display_encoded

PLOT_NEEDS = "a plot needs matplotlib; get it with pip install matplotlib, and run the same command again."
SUFFIXES = (".png", ".svg", ".pdf")
DOTS_PER_INCH = 110
COLORS = {"T1": "#c2570c", "T2": "#1b62a5"}  # told apart by any eye, and dark enough on white
FAINT = "#8a8a8a"
FEW = (1.0, 3.0)  # of the numbers of a decade, where there is little room
MOST_CROPS = 5  # along the front, and the chosen plan's
FAINTEST_ERROR = 0.05  # levels, at the dark end of the errors' colors
# Where a label may stand from its point: shares of its own width and height, and of as much again, further out.
DIRECTIONS = ((1, 0.15), (1, 1), (1, -1), (-1, 0.15), (-1, 1), (-1, -1), (0, 1), (0, -1))
DISTANCES = (7, 15, 26, 40)  # points
APART = 6  # pixels between labels side by side
FAR = 15  # from here on a thin line leads from a label to its point


def can_plot() -> bool:
    """Whether matplotlib is here."""
    return find_spec("matplotlib") is not None


def sweep_plot(sweep, path, suffix: str, title: str) -> None:
    """Draw a Sweep into a file of that suffix: every plan, the front of each truth, and crops along one of them."""
    report = sweep.report
    names = crops_of(sweep)
    figure = new_figure((11.5, 10.2))
    upper, lower = figure.subfigures(2, 1, height_ratios=(1.45, 1.0))
    axes = upper.subplots()
    draw_plans(axes, report["plans"], report["front_by"], report["fronts"])
    axes.set_title(f"{title}: what accuracy costs in time")
    draw_crops(lower, sweep, names)
    save(figure, path, suffix)


def new_figure(size):
    """An empty figure that belongs to no window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure, path, suffix: str) -> None:
    """Write a figure in the format of ``suffix``, free labels put where they overlap nothing."""
    figure.draw_without_rendering()
    for axes in figure.findobj(lambda artist: hasattr(artist, "free_labels")):
        _place_labels(figure, axes)
    figure.savefig(path, dpi=DOTS_PER_INCH, format=suffix.lstrip("."))


def draw_plans(axes, plans, key: str, fronts: dict, named=None, legend: bool = True) -> None:
    """Time against error, both logarithmic: each plan a point with its name, each truth's front a line.

    ``named``: only these plans by name, where there is no room for all."""
    axes.free_labels = []
    for truth_name, front_names in fronts.items():
        color = COLORS[truth_name]
        mine = [entry for entry in plans if entry["truth"] == truth_name]
        on_front = [entry for name in front_names for entry in mine if entry["name"] == name]
        axes.plot(*_places(on_front, key), "-", color=color, lw=1.6, alpha=0.7, label=f"front, against {truth_name}")
        for entry in mine:
            (x,), (y,) = _places([entry], key)
            axes.plot(x, y, "o", ms=7, color=color, mfc=color if entry["on_front"] else "white")
            if entry["chosen"]:
                axes.plot(x, y, "o", ms=15, mfc="none", mec="black", mew=1.4)
            if named is None or entry["name"] in named:
                axes.free_labels.append((entry["name"], x, y, "black" if entry["on_front"] else FAINT))
    axes.plot([], [], "o", ms=7, color=FAINT, mfc="white", ls="none", label="beaten in both by another plan")
    if any(entry["chosen"] for entry in plans):
        axes.plot([], [], "o", ms=12, mfc="none", mec="black", mew=1.4, ls="none", label="the chosen plan")
    axes.set(xscale="log", yscale="log", xlabel="milliseconds a frame", ylabel=f"{ERRORS[key]}, levels")
    for axis in (axes.xaxis, axes.yaxis):
        plain_numbers(axis, *(() if named is None else (FEW,)))
    axes.margins(x=0.14, y=0.14)
    axes.grid(True, which="major", alpha=0.35)
    axes.grid(True, which="minor", alpha=0.12)
    if legend:
        axes.legend(loc="upper right", fontsize=9)


def plain_numbers(axis, marks=(1.0, 2.0, 5.0)) -> None:
    """Ticks of a logarithmic axis as 0.2 or 50, not as powers of ten; ``marks``: which numbers of each decade."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis.set_major_locator(LogLocator(subs=marks, numticks=15))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _places(plans, key: str):
    return [entry["frame_ms"] for entry in plans], [max(entry["error"][key], 1e-6) for entry in plans]


def _place_labels(figure, axes) -> None:
    """Write each free label at the nearest place where it overlaps no point, line or other label."""
    canvas = figure.canvas.get_renderer()
    frame = axes.get_window_extent()
    taken = [axes.get_legend().get_window_extent(canvas).extents] if axes.get_legend() else []
    scale = figure.dpi / 72.0
    for line in axes.lines:
        points = axes.transData.transform(np.column_stack(line.get_data()).reshape(-1, 2))
        if len(points) > 1:  # so that a line counts along all its length
            steps = np.linspace(0.0, 1.0, 25)[:, None]
            points = np.concatenate([a + steps * (b - a) for a, b in pairwise(points)])
        reach = (2.0 if len(points) > 1 else 0.5 * line.get_markersize()) * scale
        taken += [(x - reach, y - reach, x + reach, y + reach) for x, y in points]
    for text, x, y, color in axes.free_labels:
        label = axes.annotate(text, (x, y), (0, 0), textcoords="offset points", fontsize=9, color=color)
        box = label.get_window_extent(canvas)
        at = axes.transData.transform((x, y))
        best = None
        for distance in DISTANCES:
            for across, up in DIRECTIONS:
                left = at[0] + across * distance * scale - (0.5 - 0.5 * across) * box.width
                low = at[1] + up * distance * scale - 0.5 * box.height
                place = (left, low, left + box.width, low + box.height)
                cost = sum(_overlap(place, other) for other in taken)
                cost += 10.0 * (box.width * box.height - _overlap(place, frame.extents))
                if best is None or cost < best[0] - 1.0:
                    best = (cost, place, distance)
        _, place, distance = best
        offset = (place[0] - at[0]) / scale, (place[1] - at[1]) / scale
        label.remove()
        leader = None if distance < FAR else dict(arrowstyle="-", color=FAINT, lw=0.7, shrinkA=1.0, shrinkB=4.0)
        axes.annotate(
            text, (x, y), offset, textcoords="offset points", fontsize=9, color=color, arrowprops=leader
        )
        taken.append((place[0] - APART, place[1], place[2] + APART, place[3]))
    axes.free_labels = []


def _overlap(one, other) -> float:
    """Area that two boxes (left, low, right, high) share."""
    wide = min(one[2], other[2]) - max(one[0], other[0])
    tall = min(one[3], other[3]) - max(one[1], other[1])
    return wide * tall if wide > 0.0 and tall > 0.0 else 0.0


def crops_of(sweep) -> list[str]:
    """The plans whose crops are shown: along the front of the chosen plan's truth, quickest first, and that plan."""
    chosen = sweep.plan(sweep.report["chosen"])
    front = sweep.report["fronts"][chosen["truth"]]
    spread = np.unique(np.linspace(0, len(front) - 1, min(len(front), MOST_CROPS)).round().astype(int))
    names = {front[n] for n in spread} | {chosen["name"]}
    return sorted(names, key=lambda name: sweep.plan(name)["frame_ms"])


def draw_crops(figure, sweep, names) -> None:
    """Two rows: the truth's crop and the plans', as a display shows them; and how far each plan's is from it."""
    from matplotlib.colors import LogNorm

    chosen = sweep.report["chosen"]
    true = sweep.truths[sweep.plan(chosen)["truth"]]
    errors = {name: np.abs(sweep.pictures[name] - true).max(axis=-1) / LEVEL for name in names}
    most = max(max(error.max() for error in errors.values()), 2.0 * FAINTEST_ERROR)
    norm = LogNorm(FAINTEST_ERROR, most)
    axes = figure.subplots(2, len(names) + 1, squeeze=False)
    for each in axes.ravel():
        each.set(xticks=[], yticks=[])
    _picture(axes[0, 0], true, f"the truth\n{sweep.plan(chosen)['truth']}")
    axes[1, 0].axis("off")
    shades = None
    for (above, below), name in zip(axes[:, 1:].T, names):
        entry = sweep.plan(name)
        bold = dict(weight="bold") if name == chosen else {}
        _picture(above, sweep.pictures[name], f"{name}\n{_digits(entry['frame_ms'])} ms", **bold)
        seen = np.maximum(errors[name], FAINTEST_ERROR)
        shades = below.imshow(seen, norm=norm, cmap="magma", interpolation="nearest")
        rmse = entry["error"]["crop"]["rmse"]
        below.set_xlabel(f"RMSE {_digits(rmse)}\nmax {_digits(errors[name].max())}", fontsize=9)
    bar = figure.colorbar(shades, cax=axes[1, 0].inset_axes((0.75, 0.0, 0.12, 1.0)), label="error, levels")
    bar.ax.yaxis.set_ticks_position("left")
    bar.ax.yaxis.set_label_position("left")
    plain_numbers(bar.ax.yaxis)


def _digits(value: float) -> str:
    """Two digits that count, without exponents."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _picture(axes, rgba, text: str, **font) -> None:
    axes.imshow(display_encoded(rgba), interpolation="nearest")
    axes.set_title(text, fontsize=9, **font)
