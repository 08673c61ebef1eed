"""The plot of error against time, with matplotlib, which is optional."""

from __future__ import annotations

from importlib.util import find_spec
from itertools import pairwise

import numpy as np

from rle_splat.accuracy.metrics import ERRORS, LEVEL, display_encoded
from rle_splat.runtime.figures import figure_text

DOTS_PER_INCH = 110
COLORS = {"T1": "#c2570c", "T2": "#1b62a5"}  # distinct with color blindness too, and dark enough on white
FAINT = "#8a8a8a"
FEW = (1.0, 3.0)  # ticks per decade in small plots
MOST_CROPS = 5  # along the front, besides the chosen plan
FAINTEST_ERROR = 0.05  # levels at the dark end of the color scale
# Directions from a point to its label, in widths and heights of the label, and distances to try.
DIRECTIONS = ((1, 0.15), (1, 1), (1, -1), (-1, 0.15), (-1, 1), (-1, -1), (0, 1), (0, -1))
DISTANCES = (7, 15, 26, 40)  # points
APART = 6  # pixels between labels side by side
FAR = 15  # points; from this distance on a thin line connects a label with its point


def can_plot() -> bool:
    """Whether matplotlib is installed."""
    return find_spec("matplotlib") is not None


def plot_sweep(sweep, path, suffix: str, title: str) -> None:
    """Plot a sweep to a file: all plans, the front of each truth, and crops of the plans along one front.

    ``suffix`` is one of SUFFIXES; ``title`` says what was measured.
    """
    report = sweep.report
    names = crops_of(sweep)
    figure = new_figure((11.5, 10.2))
    upper, lower = figure.subfigures(2, 1, height_ratios=(1.45, 1.0))
    axes = upper.subplots()
    draw_plans(axes, report["plans"], report["front_by"], report["fronts"])
    axes.set_title(f"{title}: error against time")
    draw_crops(lower, sweep, names)
    save(figure, path, suffix)


def new_figure(size):
    """An empty figure without a window; ``size`` in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure, path, suffix: str) -> None:
    """Place the free labels of a figure and write it in the format of ``suffix``."""
    figure.draw_without_rendering()
    for axes in figure.findobj(lambda artist: hasattr(artist, "free_labels")):
        _place_labels(figure, axes)
    figure.savefig(path, dpi=DOTS_PER_INCH, format=suffix.lstrip("."))


def draw_plans(axes, plans, key: str, fronts: dict, named=None, legend: bool = True) -> None:
    """Draw the plans of a report as points and the front of each truth as a line, on logarithmic axes.

    ``key``, one of ERRORS, is the error to show.  ``fronts``: truth -> names of the plans on its front.  ``named``:
    label only these plans.
    """
    axes.free_labels = []
    for truth_name, front_names in fronts.items():
        color = COLORS[truth_name]
        mine = [entry for entry in plans if entry["truth"] == truth_name]
        on_front = [entry for name in front_names for entry in mine if entry["name"] == name]
        label = "no plan is faster and more accurate" + (f" against {truth_name}" if len(fronts) > 1 else "")
        axes.plot(*_places(on_front, key), "-", color=color, lw=1.6, alpha=0.7, label=label)
        for entry in mine:
            (x,), (y,) = _places([entry], key)
            axes.plot(x, y, "o", ms=7, color=color, mfc=color if entry["on_front"] else "white")
            if entry["chosen"]:
                axes.plot(x, y, "o", ms=15, mfc="none", mec="black", mew=1.4)
            if named is None or entry["name"] in named:
                axes.free_labels.append((entry["name"], x, y, "black" if entry["on_front"] else FAINT))
    axes.plot([], [], "o", ms=7, color=FAINT, mfc="white", ls="none", label="another plan is faster and more accurate")
    for entry in plans:
        if entry["chosen"]:
            axes.plot([], [], "o", ms=12, mfc="none", mec="black", mew=1.4, ls="none", label=f"quality {entry['name']}")
    axes.set(xscale="log", yscale="log", xlabel="milliseconds per frame", ylabel=f"{ERRORS[key]}, 8-bit steps")
    for axis in (axes.xaxis, axes.yaxis):
        plain_numbers(axis, *(() if named is None else (FEW,)))
    axes.margins(x=0.14, y=0.14)
    axes.grid(True, which="major", alpha=0.35)
    axes.grid(True, which="minor", alpha=0.12)
    if legend:
        axes.legend(loc="upper right", fontsize=9)


def plain_numbers(axis, marks=(1.0, 2.0, 5.0)) -> None:
    """Label a logarithmic axis with plain numbers such as 0.2 or 50; ``marks``: the ticks in each decade."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis.set_major_locator(LogLocator(subs=marks, numticks=15))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _places(plans, key: str):
    return [entry["frame_ms"] for entry in plans], [max(entry["error"][key], 1e-6) for entry in plans]


def _place_labels(figure, axes) -> None:
    """Draw each free label at the nearest position where it overlaps no point, line or other label."""
    canvas = figure.canvas.get_renderer()
    frame = axes.get_window_extent()
    taken = [axes.get_legend().get_window_extent(canvas).extents] if axes.get_legend() else []
    scale = figure.dpi / 72.0
    for line in axes.lines:
        points = axes.transData.transform(np.column_stack(line.get_data()).reshape(-1, 2))
        if len(points) > 1:  # sample the line along its length
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
        axes.annotate(text, (x, y), offset, textcoords="offset points", fontsize=9, color=color, arrowprops=leader)
        taken.append((place[0] - APART, place[1], place[2] + APART, place[3]))
    axes.free_labels = []


def _overlap(one, other) -> float:
    """The common area of two boxes (left, low, right, high)."""
    wide = min(one[2], other[2]) - max(one[0], other[0])
    tall = min(one[3], other[3]) - max(one[1], other[1])
    return wide * tall if wide > 0.0 and tall > 0.0 else 0.0


def crops_of(sweep) -> list[str]:
    """Names of the plans whose crops are shown, fastest first: some on the front of the chosen plan's truth, and it."""
    chosen = sweep.plan(sweep.report["chosen"])
    front = sweep.report["fronts"][chosen["truth"]]
    spread = np.unique(np.linspace(0, len(front) - 1, min(len(front), MOST_CROPS)).round().astype(int))
    names = {front[n] for n in spread} | {chosen["name"]}
    return sorted(names, key=lambda name: sweep.plan(name)["frame_ms"])


def draw_crops(figure, sweep, names) -> None:
    """Draw two rows: the crops of the truth and of the plans, display-encoded, and the error of each plan's crop."""
    from matplotlib.colors import LogNorm

    chosen = sweep.report["chosen"]
    true = sweep.truths[sweep.plan(chosen)["truth"]]
    errors = {name: np.abs(sweep.pictures[name] - true).max(axis=-1) / LEVEL for name in names}
    most = max(max(error.max() for error in errors.values()), 2.0 * FAINTEST_ERROR)
    norm = LogNorm(FAINTEST_ERROR, most)
    axes = figure.subplots(2, len(names) + 1, squeeze=False)
    for each in axes.ravel():
        each.set(xticks=[], yticks=[])
    _picture(axes[0, 0], true, f"the reference\n{sweep.plan(chosen)['truth']}")
    axes[1, 0].axis("off")
    shades = None
    for (above, below), name in zip(axes[:, 1:].T, names):
        entry = sweep.plan(name)
        bold = dict(weight="bold") if name == chosen else {}
        _picture(above, sweep.pictures[name], f"{name}\n{figure_text(entry['frame_ms'])} ms", **bold)
        seen = np.maximum(errors[name], FAINTEST_ERROR)
        shades = below.imshow(seen, norm=norm, cmap="magma", interpolation="nearest")
        rmse = entry["error"]["crop"]["rmse"]
        below.set_xlabel(f"RMSE {figure_text(rmse)}\nmax {figure_text(errors[name].max())}", fontsize=9)
    bar = figure.colorbar(shades, cax=axes[1, 0].inset_axes((0.75, 0.0, 0.12, 1.0)), label="error, 8-bit steps")
    bar.ax.yaxis.set_ticks_position("left")
    bar.ax.yaxis.set_label_position("left")
    plain_numbers(bar.ax.yaxis)


def _picture(axes, rgba, text: str, **font) -> None:
    axes.imshow(display_encoded(rgba), interpolation="nearest")
    axes.set_title(text, fontsize=9, **font)
