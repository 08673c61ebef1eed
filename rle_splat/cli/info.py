"""``rle-splat info``: describe a volume and report unusual data, without rendering."""

from itertools import count

import numpy as np

from ..pipeline.memory_estimate import picture_bytes
from ..pipeline.quick_estimate import count_in_planes, estimate_visible, likely_sides
from ..read.dicom.grouping import SeveralSeries
from ..read.dicom.titles import series_info
from ..runtime.memory import available_bytes, bytes_text
from ..runtime.outputs import check_outputs, write_report
from ..runtime.whole_files import whole_files
from ..scene import RECORDS, Quality
from ..volume.axes import AXES
from ..volume.counts import counts_values
from ..volume.few_planes import few_planes
from ..volume.histogram import histogram, percentiles
from ..volume.orientation import axis_letters, orientation_text
from ..volume.volume import PATIENT
from . import options
from .appearance import choose_transfer_function, read_transfer_function
from .progress import ProgressLine
from .report import number_text

PERCENTS = (1.0, 25.0, 50.0, 75.0, 99.0, 99.9)
# Bins of the histogram in the JSON report: one per value of 8-bit data, enough to show the peaks of other types.
REPORT_BINS = 256
# Rows and columns of the histogram as text.
TEXT_ROWS, TEXT_COLUMNS = 16, 48
# A value that more than this share of the voxels have gets a remark.
MOSTLY_ONE_VALUE = 0.5


def add_arguments(parser) -> None:
    options.add_volume_argument(parser)
    options.add_report_options(parser)
    options.add_volume_options(parser)
    options.add_transfer_function_options(parser)


def run(args) -> None:
    outputs = [args.json] if args.json else []
    check_outputs(outputs, inputs=(args.volume, args.transfer_function))

    with ProgressLine(args.progress) as line:
        given_function = read_transfer_function(args)
        try:
            volume = options.read_input(args, line, quick=True)
        except SeveralSeries as several:
            if args.series is not None:
                raise
            report, lines_of = describe_series(several), series_lines
        else:
            line.show(None, "counting values")
            looked_at = few_planes(volume)
            choice = choose_transfer_function(args, looked_at, given_function)
            line.show(None, "counting visible voxels")
            report, lines_of = describe(volume, choice, looked_at), text_lines
        report["command"] = "info"
        report["input"] = str(args.volume)
        with whole_files(outputs) as parts:
            if args.json:
                write_report(parts[0], report)
    print("\n".join(lines_of(report)))


def describe_series(several: SeveralSeries) -> dict:
    """The report of a place that holds several series: what each is, without its free text."""
    rows = zip(map(series_info, several.groups, count(1)), several.titles)
    return {"series": [{**vars(info), "title": title} for info, title in rows]}


def series_lines(report: dict) -> list[str]:
    """The report of several series as lines of text."""
    found = [str(report["input"])]
    for row in report["series"]:
        found.append(f"  series {row['number']:<5}{row['title']}")
        if row["problem"]:
            found.append(f"  {'odd':<12}{row['problem']}")
    return [*found, "Choose one with --series N."]


def describe(volume, choice, looked_at=None) -> dict:
    """The report of a volume.

    Parameters
    ----------
    choice : tuple
        The transfer function that a picture would use, and the reason for it.
    looked_at : Volume, optional
        A few planes of it (see ``few_planes``), whose values stand for all. By default, the volume itself.

    Returns
    -------
    dict
        The report, ready for JSON after ``report.plain``.
    """
    function, reason = choice
    looked_at = looked_at or volume
    if looked_at is not volume and counts_values(volume.voxels.dtype):  # else all voxels would be read for them
        share = len(volume.voxels) / len(looked_at.voxels)
        volume.measured["value_counts"] = np.rint(share * looked_at.value_counts).astype(np.int64)
    counted = histogram(looked_at, bins=REPORT_BINS)
    low, high = looked_at.value_range
    visible, needed = _needs(volume, function)
    return {
        **_grid(volume),
        "slope": volume.slope,
        "intercept": volume.intercept,
        "value_unit": volume.value_unit,
        "modality": volume.modality,
        "range": (low, high),
        "percentiles": {number_text(p): v for p, v in zip(PERCENTS, percentiles(looked_at, PERCENTS))},
        "histogram": {"counts": counted.counts, "edges": counted.edges},
        "not_finite": counted.not_finite,
        "remarks": [*looked_at.remarks, *_odd(volume, counted, (low, high))],
        "transfer_function": {"name": function.name, "reason": reason, "visible_fraction": visible},
        **needed,
    }


def _grid(volume) -> dict:
    """What the report says of the voxels but for their values."""
    return {
        "name": volume.name,
        "shape_xyz": volume.shape_xyz,
        "type": volume.voxels.dtype.name,
        "spacing": volume.spacing,
        "affine": volume.affine,
        "unit": volume.unit,
        "space": volume.space,
        "orientation": orientation_text(volume.affine) if volume.space == PATIENT else None,
        "axis_letters": axis_letters(volume.affine) if volume.space == PATIENT else None,
        "frames": volume.frames,
        "levels": volume.levels,
        "labels": [{"label": one.label, "name": one.name, "color": one.color} for one in volume.named_labels],
        "extent": (np.array(volume.shape_xyz) - 1) * volume.spacing,
    }


def _needs(volume, function) -> tuple[float, dict]:
    """The share of the voxels that are visible, and what the report says of the memory for them."""
    quality = Quality()  # the defaults of the command render
    picture = picture_bytes(
        (likely_sides(volume.shape_xyz, quality, *options.DEFAULT_SIZE),), *options.DEFAULT_SIZE, quality
    )
    found, shaded = count_in_planes(volume, function), function.shade is not None
    memory = estimate_visible(found, quality, shaded=shaded, picture=picture)

    def with_records(record: int, axes: int, picture: int) -> int:
        of_record = Quality(classification="pre", record=record)
        return estimate_visible(found, of_record, axes=axes, shaded=shaded, picture=picture).needed

    return memory.visible_fraction, {
        "memory_bytes": {
            "voxels": memory.volume,
            "classified": memory.visible + memory.normals,
            "tables_of_one_axis": memory.runs + memory.records,
            "work": memory.work,
            "picture": memory.picture,
            "total": memory.volume + memory.needed,
            "available": available_bytes(),
        },
        "records": {
            record: {"render": with_records(record, 1, picture), "encode": with_records(record, len(AXES), 0)}
            for record in RECORDS
        },
    }


def _odd(volume, counted, low_high) -> list[str]:
    """Sentences on unusual values; ``low_high``: their range."""
    total = counted.total
    odd = []
    if counted.not_finite == total:
        return ["No voxel holds a finite number; there is nothing to see."]
    if counted.not_finite:
        odd.append(f"{counted.not_finite} voxels ({counted.not_finite / total:.2%}) are NaN or infinite.")
    if low_high[0] == low_high[1]:
        odd.append(f"Every voxel holds the same value, {number_text(low_high[0])}.")
    elif counted.counts.max() > MOSTLY_ONE_VALUE * total:
        fullest = int(counted.counts.argmax())
        near = number_text(counted.centers[fullest])
        odd.append(f"{counted.counts[fullest] / total:.0%} of the voxels have about the same value, {near}.")
    spacing = volume.spacing
    if spacing.max() > 4.0 * spacing.min():
        odd.append(f"The spacing is very uneven ({_times(spacing)}); check it, and give --spacing if it is wrong.")
    return odd


def text_lines(report: dict) -> list[str]:
    """The report as lines of text."""
    unit = report["value_unit"] or "no unit"
    function, memory = report["transfer_function"], report["memory_bytes"]
    facts = [
        ("shape", f"{_times(report['shape_xyz'])} voxels (x, y, z)"),
        ("type", f"{report['type']}, {bytes_text(memory['voxels'])}"),
        ("spacing", f"{_times(report['spacing'])} {report['unit']}"),
        ("extent", f"{_times(report['extent'])} {report['unit']} between the outermost voxel centers"),
        ("orientation", report["orientation"] or "not stated"),
        ("modality", report["modality"] or "not known"),
        ("values", f"{number_text(report['range'][0])} to {number_text(report['range'][1])} ({unit})"),
        ("scaling", f"value = {number_text(report['slope'])} * stored + {number_text(report['intercept'])}"),
        ("percentiles", ", ".join(f"{p}%: {number_text(v)}" for p, v in report["percentiles"].items())),
        ("default", function["reason"]),
        ("visible", f"about {function['visible_fraction']:.1%} of the voxels with it"),
        ("memory", f"about {bytes_text(memory['total'])} to render {_times(options.DEFAULT_SIZE)} pixels"),
        ("", f"{bytes_text(memory['voxels'])} of it are the voxels"),
        ("", f"{_records_text(report['records'])}; {bytes_text(memory['available'])} are free"),
    ]
    if report["frames"] > 1:
        facts.insert(1, ("frames", f"{report['frames']}; --frame chooses one"))
    if report["levels"]:
        facts.insert(1, ("levels", ", ".join(f"{n}: {_times(shape)}" for n, shape in enumerate(report["levels"]))))
    if report["labels"]:
        facts.append(("labels", ", ".join(f"{one['label']} {one['name']}" for one in report["labels"])))
    lines = [str(report["input"])]
    lines += [f"  {name:<12}{text}" for name, text in facts]
    lines += [f"  {'affine' if row == 0 else '':<12}{_row(values)}" for row, values in enumerate(report["affine"])]
    lines += [f"  {'odd':<12}{remark}" for remark in report["remarks"]]
    lines.append("  histogram   (bars in proportion to the logarithm of the counts)")
    return lines + _bars(report["histogram"])


def _records_text(records: dict) -> str:
    """The memory for encoding all three axes with each size of voxel record."""
    sizes = ", ".join(f"{record}: {bytes_text(needs['encode'])}" for record, needs in records.items())
    return f"three axes encoded, by --record: {sizes}"


def _bars(counted: dict) -> list[str]:
    """The histogram as text, with adjacent bins merged into at most TEXT_ROWS rows."""
    counts, edges = np.asarray(counted["counts"]), np.asarray(counted["edges"])
    width = -(-counts.size // TEXT_ROWS)
    starts = np.arange(0, counts.size, width)
    sums = np.add.reduceat(counts, starts)
    heights = np.log1p(sums) / max(1.0, np.log1p(sums).max())
    lows = edges[starts]
    return [
        f"  {number_text(low):>12}  {'#' * int(np.ceil(TEXT_COLUMNS * height)):<{TEXT_COLUMNS}}  {count}"
        for low, height, count in zip(lows, heights, sums)
    ]


def _times(numbers) -> str:
    return " x ".join(number_text(n) for n in numbers)


def _row(numbers) -> str:
    return " ".join(f"{number_text(n):>10}" for n in numbers)
