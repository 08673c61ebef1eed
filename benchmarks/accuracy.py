"""Error against time: makes every figure and table of the page accuracy.md.

A CT, an MR and a cloud of smoke are measured in orthographic and perspective views, as ``rle-splat accuracy`` does.  On
the orthographic views every knob is varied by itself.  The tables are written between marks in the page, the numbers
into accuracy.json beside it and the pictures into docs/images; the other text of the page is not changed.
"""

from __future__ import annotations

import json
import re
import sys
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from statistics import geometric_mean

from rle_splat.accuracy.metrics import ERRORS
from rle_splat.accuracy.planner.measure_plans import CROP_SIDE, TOLERANCES, front, sweep_steps
from rle_splat.accuracy.planner.plans import possible, same_plan, sensible_plans
from rle_splat.classify.presets import fit_preset
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.read.formats import read_volume
from rle_splat.runtime.figures import figure_text
from rle_splat.runtime.steps import drain
from rle_splat.scene import CLASSIFICATIONS, QUALITY_PRESETS, Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

from .accuracy_plot import can_plot, draw_plans, new_figure, plain_numbers, plot_sweep, save
from .data_sets import PAPER
from .flip import mean_flip
from .frames import Neighbors, circumstances, describe, time_by_processor
from .lamps import under
from .run import make_parser
from .scenes import DATA, REAL, smoke

DOCS = Path(__file__).resolve().parents[1] / "docs" / "explanation"
SIZE, PROBES, REPEATS = 512, 1000, 3
STANDARD = Quality.preset("standard")
PROJECTIONS = {"orthographic": False, "perspective": True}
DEPTH_RULES = (
    "slice-2", "slice", "simpson", "midpoint-4", "midpoint-8", "preintegrated", "preintegrated-2", "preintegrated-4",
)  # fmt: skip
# Every knob varied alone, the others as in standard: title -> (value as shown, fields of Quality).
KNOBS = {
    "depth rule": [(rule, dict(depth_rule=rule)) for rule in DEPTH_RULES],
    "sheet density": [(f"{density:g}", dict(sheet_density=density)) for density in (0.5, 0.7, 1.0, 1.5, 2.0, 3.0)],
    "warp filter": [(name, dict(warp_filter=name)) for name in ("bilinear", "keys", "cubic")],
    "termination": [(f"1/{n}", dict(termination=1.0 / n)) for n in (64, 256, 1024, 8192)],
    "classification": [(name, dict(classification=name)) for name in CLASSIFICATIONS],
    "record (pre)": [(f"{size} bytes", dict(classification="pre", record=size)) for size in (8, 16)],
}  # fmt: skip
# The truth for a knob's errors, if it is not that of each plan.
AGAINST = {"classification": "T2", "record (pre)": "T1"}
NAMED = (*QUALITY_PRESETS, "pre standard", "paper")  # the plans that are labeled in small plots
SERIES = ("#1b62a5", "#c2570c", "#3b7d3a", "#7b4ea3")


@dataclass(frozen=True, eq=False)
class Subject:
    """A volume with a transfer function and a view (azimuth, elevation); ``note``: remark if it is a stand-in."""

    name: str
    volume: Volume
    function: TransferFunction
    view: tuple[float, float]
    note: str = ""

    def scene(self, size: int, perspective: bool) -> Scene:
        camera, matrix = turntable(self.volume, *self.view, 1.1, perspective)
        return Scene(self.volume, self.function, camera, size, size, matrix)


def scan(name: str, view, preset: str = "") -> Subject:
    """A real scan with a preset, or the stand-in of bench paper if the scan is missing."""
    file, options, usual = REAL[name]
    if (DATA / file).exists():
        volume = read_volume(DATA / file, **options)
        function, _ = fit_preset(preset or usual, volume)
        return Subject(name, volume, function, view)
    title, volume, function = next(data for data in PAPER if data.name == name).load()
    return Subject(title, volume, function, view, "The scan is missing; this is a synthetic stand-in.")


def narrow(subject: Subject) -> Subject:
    """The same volume with opacity only in a band of 1/50 of its range, the hardest case for pre-classification."""
    low, high = (float(value) for value in subject.volume.value_range)
    points, colors = subject.function.opacity, subject.function.color
    # The value at which the opacity first reaches half its maximum: the visible surface.
    center = next((value for value, alpha in points if alpha >= 0.5 * max(a for _, a in points)), 0.5 * (low + high))
    half = 0.01 * (high - low)
    function = replace(
        subject.function, name=f"{subject.function.name}, narrow",
        opacity=((center - half, 0.0), (center, 0.8), (center + half, 0.0)), color=colors,
    )  # fmt: skip
    return replace(subject, name=f"{subject.name}, narrow", function=function)


def subjects() -> list[Subject]:
    plume = smoke()
    return [
        scan("CT head", (215.0, 170.0)), scan("MRI head", (200.0, 60.0)),
        Subject("smoke", plume, fit_preset("smoke", plume)[0], (30.0, 15.0)),
    ]  # fmt: skip


def variants(base: Quality) -> dict[str, Quality]:
    """The plans with one knob changed, by name ``knob: value``; impossible combinations are left out.

    For another classification the other knobs are those of its own standard."""
    plans = {}
    for knob, values in KNOBS.items():
        for value, fields in values:
            usual = Quality.preset("standard", classification=fields.get("classification", base.classification))
            plain = replace(usual, threads=base.threads)
            plans[f"{knob}: {value}"] = possible(plain, name=f"{knob}: {value}", **fields)
    return {name: plan for name, plan in plans.items() if plan is not None}


def measure(subject: Subject, perspective: bool, options, with_knobs: bool, light: str = "headlight"):
    """(Sweep, name in ``variants`` -> name of the plan in the sweep) of one subject and projection."""
    base = replace(STANDARD, threads=options.threads)
    plans, names = sensible_plans(base), {}
    for name, plan in variants(base).items() if with_knobs else ():
        # A preset would take the plan that suits the scene, in which more than one knob differs.
        equal = next((other for other in plans if same_plan(plan, other) and not other.is_preset), None)
        if equal is None:
            plans.append(plan)
        names[name] = plan.name if equal is None else equal.name
    # The last plan decides the crop and the steep probes, so it must be the best one.
    plans.sort(key=lambda plan: (plan.classification, plan.record, plan.name == "strict"))
    scene = under(subject.scene(options.size, perspective), light)
    steps = sweep_steps(
        scene, plans, base, probes=options.probes, repeats=options.repeats, tolerances=TOLERANCES, flip=mean_flip,
        crop_side=min(CROP_SIDE, options.size // 2),
    )  # fmt: skip
    return drain(steps), names


# --- tables -------------------------------------------------------------------------------------------------------


def is_variant(entry: dict) -> bool:
    return entry["name"].split(":")[0] in KNOBS


def ladder(report: dict) -> list[dict]:
    """The plans of a report without single-knob variants, with the front of each truth determined among them."""
    mine = [dict(entry) for entry in report["plans"] if not is_variant(entry)]
    for truth in {entry["truth"] for entry in mine}:
        alike = [entry for entry in mine if entry["truth"] == truth]
        names = front(alike)
        for entry in alike:
            entry["on_front"] = entry["name"] in names
    return mine


def markdown(header, rows) -> str:
    lines = [f"| {' | '.join(header)} |", f"|{'---|' * len(header)}"]
    return "\n".join(lines + [f"| {' | '.join(row)} |" for row in rows])


def plans_table(views: dict) -> str:
    """Every plan on every view: milliseconds, RMSE, largest error; "-" if a plan was not measured on a view."""
    ladders = {title: {entry["name"]: entry for entry in ladder(report)} for title, report in views.items()}
    every = {name: entry for mine in reversed(ladders.values()) for name, entry in mine.items()}
    rows = []
    for name, first in sorted(every.items(), key=lambda item: (item[1]["truth"] != "T2", item[1]["frame_ms"])):
        cells = [_plan_cell(mine.get(name)) for mine in ladders.values()]
        rows.append([name, first["truth"], *cells])
    return markdown(["plan", "reference", *views], rows)


def _plan_cell(entry: dict | None) -> str:
    if entry is None:
        return "-"
    error = entry["error"]
    text = f"{entry['frame_ms']:.0f} ms, {figure_text(error['rmse'])} / {figure_text(error['largest'])}"
    return f"**{text}**" if entry["on_front"] else text


def tolerance_table(views: dict) -> str:
    """The fastest measured plan whose largest error is within each tolerance."""
    truth = _main_truth(views)
    rows = []
    for tolerance in TOLERANCES:
        cells = []
        for report in views.values():
            mine = [e for e in ladder(report) if e["truth"] == truth]
            keeps = [e for e in mine if e["error"]["largest"] <= tolerance]
            best = min(keeps, key=lambda e: e["frame_ms"], default=None)
            floor = min(e["error"]["largest"] for e in mine)
            cells.append(f"{best['frame_ms']:.0f} ms, {best['name']}" if best else f"not reached; {figure_text(floor)}")
        rows.append([f"{tolerance:g}", *cells])
    return markdown([f"8-bit steps at most, against {truth}", *views], rows)


def _main_truth(views: dict) -> str:
    return next(entry["truth"] for entry in next(iter(views.values()))["plans"] if entry["chosen"])


def knob_points(report: dict, names: dict, knob: str) -> list[tuple[str, float, float]]:
    """(value, RMSE in levels, milliseconds) of the plans of one knob."""
    by_name = {entry["name"]: entry for entry in report["plans"]}
    found = []
    for value, _ in KNOBS[knob]:
        name = names.get(f"{knob}: {value}")
        if name is None:
            continue
        entry = by_name[name]
        beside = AGAINST.get(knob) == "T2" and entry["truth"] != "T2"
        error = entry["as_ray_caster"] if beside else entry["error"]
        found.append((value, error["rmse"], entry["frame_ms"]))
    return found


def families(points) -> list[list]:
    """The points of a knob in their order, those of preintegrated depth rules apart: a line from one to others would
    look like a trend."""
    return [list(family) for _, family in groupby(points, lambda point: point[0].startswith("preintegrated"))]


def knobs_table(measured: dict, names: dict) -> str:
    """Error and time of each knob's values as factors of standard, geometric means over the subjects."""
    rows = []
    for knob in KNOBS:
        points = {title: knob_points(report, names[title], knob) for title, report in measured.items()}
        if len(next(iter(points.values()))) < 2:
            continue
        reference = {title: _reference(mine, knob) for title, mine in points.items()}
        cells = []
        for n, (value, _, _) in enumerate(next(iter(points.values()))):
            error, ms = (
                geometric_mean(max(mine[n][i], 1e-9) / max(reference[title][i], 1e-9) for title, mine in points.items())
                for i in (1, 2)
            )
            same = all(mine[n] == reference[title] for title, mine in points.items())
            cells.append(f"**{value}**" if same else f"{value}: {_factor(error)}, {_factor(ms)}")
        rows.append([knob, AGAINST.get(knob, "its own"), "; ".join(cells)])
    return markdown(["knob", "reference", "value: error, time, as factors of the value in bold"], rows)


def _reference(points, knob: str):
    """The point of standard, or of the knob's last value if standard is not among them."""
    fields = dict(KNOBS[knob])
    for point in points:
        if all(getattr(STANDARD, name) == value for name, value in fields[point[0]].items()):
            return point
    return points[-1]


def _factor(ratio: float) -> str:
    return f"×{figure_text(ratio)}"


def losses_table(measured: dict, names: dict) -> str:
    """Errors of each classification against T2, the other knobs as in standard, and of the paper's pipeline."""
    ways = {f"`{value}`, usual plan": f"classification: {value}" for value, _ in KNOBS["classification"]}
    rows = []
    for way, variant in {"the paper to the letter": "paper", **ways}.items():
        cells = []
        for title, report in measured.items():
            name = names[title].get(variant, variant)
            entry = next(entry for entry in report["plans"] if entry["name"] == name)
            error = entry["as_ray_caster"] or entry["error"]
            cells.append(f"{figure_text(error['rmse'])} / {figure_text(error['largest'])}, {entry['frame_ms']:.0f} ms")
        rows.append([way, *cells])
    return markdown(["against T2: RMSE / largest", *measured], rows)


# --- pictures -----------------------------------------------------------------------------------------------------


def fronts_plot(views: dict, path: Path) -> None:
    """One small plot per view with the plans that are measured against T2; only the presets are labeled.

    Plans that classify first are measured against T1, an easier reference: beside the others they would look better
    than they are.
    """
    columns = (len(views) + 1) // 2
    figure = new_figure((4.4 * columns, 8.0))
    grid = figure.subplots(2, columns, sharey=True, sharex=True)
    for axes, (title, report) in zip(grid.T.ravel(), views.items()):
        plans = [entry for entry in ladder(report) if entry["truth"] == "T2"]
        draw_plans(axes, plans, "rmse", {"T2": front(plans)}, named=NAMED, legend=False)
        axes.set_title(title, fontsize=11)
        axes.label_outer()
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=4, fontsize=10)
    save(figure, path, ".png")


def knobs_plot(measured: dict, names: dict, path: Path) -> None:
    """A column a knob: error above, time below, a line a subject and a family of values."""
    knobs = [knob for knob in KNOBS if len(knob_points(*_first(measured, names), knob)) > 1]
    figure = new_figure((2.6 * len(knobs), 6.4))
    grid = figure.subplots(2, len(knobs), sharex="col", sharey="row")
    for (above, below), knob in zip(grid.T, knobs):
        for (title, report), color in zip(measured.items(), SERIES):
            for n, family in enumerate(families(knob_points(report, names[title], knob))):
                values, errors, times = zip(*family)
                above.plot(values, errors, "o-", ms=4, color=color, label=None if n else title)
                below.plot(values, times, "o-", ms=4, color=color)
        above.set_title(f"{knob}\nagainst {AGAINST[knob]}" if knob in AGAINST else knob, fontsize=10)
        below.tick_params(axis="x", rotation=60, labelsize=9)
        for axes in (above, below):
            axes.set_yscale("log")
            axes.grid(True, which="major", alpha=0.35)
    for axes, text in zip(grid[:, 0], (f"{ERRORS['rmse']}, 8-bit steps", "milliseconds a frame")):
        axes.set_ylabel(text)
        plain_numbers(axes.yaxis)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=len(measured), fontsize=9)
    save(figure, path, ".png")


def _first(measured: dict, names: dict):
    title = next(iter(measured))
    return measured[title], names[title]


def shadowed_plot(subject: Subject, options, path: Path) -> None:
    """The sweep of a subject under a sun with shadows, with crops along its front."""
    sweep, _ = measure(subject, False, options, with_knobs=False, light="sun")
    plot_sweep(sweep, path, ".png", f"{subject.name}, {subject.function.name}, under a sun with shadows")


# --- the page -----------------------------------------------------------------------------------------------------


def fill(page: str, blocks: dict[str, str]) -> str:
    """The page with new text between its marks ``<!-- begin NAME -->`` and ``<!-- end NAME -->``, by the name.

    Raises ValueError if a name is not marked exactly once.
    """
    for name, text in blocks.items():
        pattern = re.compile(f"(<!-- begin {name} -->\n).*?(<!-- end {name} -->)", re.DOTALL)
        page, count = pattern.subn(lambda found, text=text: f"{found[1]}\n{text}\n\n{found[2]}", page)
        if count != 1:
            raise ValueError(f"the page has {count} blocks called {name}; mark it exactly once")
    return page


def plain_report(measured: dict) -> dict:
    """The reports for accuracy.json, without their texts."""
    return {
        title: {key: value for key, value in report.items() if key not in ("truths", "remarks")}
        for title, report in measured.items()
    }


def main(arguments) -> int:
    parser = make_parser("dev.py accuracy", __doc__, size=SIZE, probes=PROBES, repeats=REPEATS, threads=0)
    parser.add_argument("--output", type=Path, default=DOCS, help="folder of the page; plots go to ../images")
    options = parser.parse_args(arguments)
    where, neighbors = circumstances(options.threads), Neighbors()
    print(describe(where), flush=True)
    if options.threads == 1:
        time_by_processor()
    views, knobs, names = {}, {}, {}
    things = subjects()
    for subject in things:
        for projection, perspective in PROJECTIONS.items():
            title = f"{subject.name}, {projection}"
            sweep, used = measure(subject, perspective, options, with_knobs=not perspective)
            views[title] = sweep.report
            if not perspective:
                knobs[subject.name], names[subject.name] = sweep.report, used
            print(f"{title}: {len(sweep.report['plans'])} plans", flush=True)
    hard = narrow(things[0])
    sweep, used = measure(hard, False, options, with_knobs=True)
    knobs[hard.name], names[hard.name] = sweep.report, used
    said = neighbors.describe()
    print(said)
    write_page(options, views, knobs, names, [describe(where), said, *{s.note for s in things if s.note}])
    images = options.output.parent / "images"
    images.mkdir(parents=True, exist_ok=True)
    record = {"circumstances": {**where, "others_busy_cores": neighbors.cores()},
              "views": plain_report({**views, hard.name: knobs[hard.name]})}  # fmt: skip
    (options.output / "accuracy.json").write_text(compact(record), encoding="utf-8")
    if can_plot():
        fronts_plot(views, images / "accuracy-fronts.png")
        knobs_plot(knobs, names, images / "accuracy-knobs.png")
        shadowed_plot(things[0], options, images / "accuracy-sweep.png")
    else:
        print("matplotlib is not installed, so the figures were not changed.", file=sys.stderr)
    return 0


def write_page(options, views, knobs, names, circumstances_said) -> None:
    """Fill the tables of both pages in place."""
    first = next(iter(views.values()))
    probes = first["probes"]
    how = (
        f"{options.size} x {options.size} pixels, {first['threads']} threads; the median of {options.repeats} frames; "
        f"{probes['random']} random sample pixels, {probes['steep']} steep ones and a crop of each view."
    )
    pages = {
        "accuracy.md": {
            "tolerances": tolerance_table(views), "knobs": knobs_table(knobs, names),
            "losses": losses_table(knobs, names), "circumstances": " ".join([how, *circumstances_said]),
        },
        "accuracy-measured.md": {"plans": plans_table(views)},
    }  # fmt: skip
    for name, blocks in pages.items():
        page = options.output / name
        text = (page if page.exists() else DOCS / name).read_text(encoding="utf-8")
        page.write_text(fill(text, blocks), encoding="utf-8")


def compact(record: dict) -> str:
    """JSON with one plan per line, so that a diff shows which plan changed."""
    text = json.dumps(record, indent=1, default=str)
    squeeze = re.compile(r'\{\s*"name".*?\n   \}', re.DOTALL)
    return squeeze.sub(lambda found: re.sub(r"\s*\n\s*", " ", found[0]), text) + "\n"
