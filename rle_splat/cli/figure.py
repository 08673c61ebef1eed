"""``rle-splat figure``: make a figure for print, or make one again from its sidecar."""

from dataclasses import replace
from pathlib import Path
from time import perf_counter

from ..figure.files import CONTENTS, SIDECAR_SUFFIX, PageCanvas, sidecar_path
from ..figure.plan import CM_TO_MM, MM_PER_INCH, Figure, tile_size
from ..read.channels import level_options, read_channel_steps
from ..read.formats import format_named, read_steps
from ..read.labels import read_label_steps
from ..runtime.outputs import check_outputs, write_report
from ..runtime.whole_files import whole_files, writing
from ..scene import RleSplatError
from ..segment.body import map_steps
from ..volume.checks import check_values
from . import options
from .appearance import read_transfer_function
from .figure_files import FURTHER, check_figure_file, write_page
from .figure_options import add_figure_options, list_panels, panels_of, style_from
from .light_options import (
    add_light_effect_options,
    check_light_effects,
    read_sky,
    with_light_effects,
    with_light_recipe,
)
from .mixing import add_mixing_options, hide_table, mix, mixing_inputs, read_further, read_mixing
from .progress import ProgressLine
from .viewing import check_scene_options, make_scene, place, read_lights, read_placement

BODY = "body"  # option of a sidecar's labels that are the body found in its data, not a file
# Options that count when a figure is made again; its sidecar holds all others.
OF_A_REMAKE = (
    "volume", "output", "data", "labels", "channel", "json", "progress", "threads", "memory_limit", "debug", "command",
    "run", "prog", "defaults",
)  # fmt: skip


def add_arguments(parser) -> None:
    options.add_volume_argument(parser, also=(SIDECAR_SUFFIX,))
    suffixes = ",".join(suffix[1:] for suffix in (*CONTENTS, *FURTHER))
    parser.add_argument(
        "-o", "--output", action="append", required=True, metavar=f"FIG.{{{suffixes}}}",
        help=f"the figure to write; may be given several times. FIG{SIDECAR_SUFFIX} is written beside the first one; "
        "given in place of VOLUME, it makes the same figure again",
    )  # fmt: skip
    parser.add_argument(
        "--data",
        metavar="FILE",
        help="where the data of a sidecar is now; --labels and --channel do the same for its labels and channels",
    )
    add_figure_options(parser)
    options.add_mode_option(parser)
    options.add_mist_option(parser)
    options.add_report_options(parser)
    options.add_scene_options(parser)
    options.add_clip_option(parser)
    add_light_effect_options(parser, with_pass=False)
    add_mixing_options(parser)
    options.add_quality_options(parser)
    parser.set_defaults(defaults=parser.get_default)


def run(args) -> None:
    start = perf_counter()
    for path in args.output:
        check_figure_file(path)
    again = Path(args.volume).suffix.lower() == ".json" and format_named(args.volume) is None  # a zarr.json is data
    with ProgressLine(args.progress) as line:
        made, remarks, sidecar = _make_again(args, line) if again else _make(args, line)
        line.show(1.0, "writing")
        written = _write(args, made, remarks, sidecar)
    print("\n".join(remarks), end="\n" if remarks else "")
    page = made.page
    wide, tall = (side / page.dpi * MM_PER_INCH / CM_TO_MM for side in (page.width, page.height))
    print(
        f"Wrote {', '.join(written)} ({page.width} x {page.height} pixels, {wide:.1f} x {tall:.1f} cm) in "
        f"{perf_counter() - start:.2f} s."
    )


def _check_outputs(args, inputs, further=()) -> None:
    check_outputs([*args.output, *further, *([args.json] if args.json else [])], inputs=inputs)


def _write(args, made, remarks, sidecar: dict | None) -> list[str]:
    """Write all files of a figure, with its ``sidecar`` if one is given; return their names."""
    targets = [*args.output, *([str(sidecar_path(args.output[0]))] if sidecar is not None else [])]
    canvas = PageCanvas(made.page)
    with whole_files([*targets, *([args.json] if args.json else [])]) as parts:
        for path, part in zip(args.output, parts):
            with writing(path):
                write_page(part, Path(path).suffix.lower(), made.page, canvas)
        if sidecar is not None:
            write_report(parts[len(args.output)], sidecar)
        if args.json:
            write_report(parts[-1], _report(args, made, remarks, targets))
    return targets


def _report(args, made, remarks, written) -> dict:
    return {
        "command": "figure",
        "input": {"path": str(args.volume)},
        "page": {"width": made.page.width, "height": made.page.height, "dpi": made.page.dpi},
        "panels": [
            {"title": panel.title, **rendering.report} for panel, rendering in zip(made.figure.panels, made.renderings)
        ],
        "remarks": list(remarks),
        "outputs": list(written),
    }


# --- a new figure -----------------------------------------------------------------------------------------------------


def _make(args, line):
    """Make a figure of a volume; return (MadeFigure, remarks, sidecar)."""
    from ..figure.sidecar import sidecar_of
    from ..figure.sources import DataSource, Sources

    if args.data is not None:
        raise RleSplatError(
            "--data gives the place of the data of a sidecar; give the volume itself in place of VOLUME."
        )
    wanted = list_panels(args, read_transfer_function)
    compared = [one.transfer_function for one in wanted.functions]
    _check_outputs(args, (*options.scene_inputs(args), *mixing_inputs(args), *compared), [sidecar_path(args.output[0])])
    style = style_from(args)
    args.size = tile_size(style, wanted.count)
    for view in wanted.views:
        view.size = args.size
    check_scene_options(args)
    args.tolerance = None
    check_light_effects(args)
    quality, mixing, sky = options.quality_from(args), read_mixing(args), read_sky(args)
    camera, matrix = read_placement(args)
    lights = read_lights(args)
    line.show(0.0, f"reading {Path(args.volume).name}")
    volume = options.read_input(args, line)
    check_values(volume)
    further = read_further(args, volume, line)

    def scene_of(view, function):
        scene = make_scene(view, volume, function, *place(view, volume, camera, matrix), *lights)
        return mix(args, with_light_effects(args, scene, sky), mixing, further)

    panels, reasons = panels_of(args, volume, wanted, scene_of)
    table, more = (None, ()) if args.compare else hide_table(args, volume, panels[0].scene.transfer_function, line)
    labels = None if args.labels is None else DataSource(_use_slashes(args.labels))
    if table is not None:
        panels = [replace(panel, scene=replace(panel.scene, labels=table)) for panel in panels]
        labels = DataSource(_use_slashes(args.volume), {BODY: True})
    panels = [replace(panel, scene=with_light_recipe(args, panel.scene)) for panel in panels]
    frames = args.fit is None and camera is None
    made = _render(Figure(tuple(panels), style), [quality] * wanted.count, line, frames=frames)
    remarks = (*reasons, *further.remarks, *more, *made.remarks, *options.quality_remarks(args, quality))
    sources = Sources(
        DataSource(_use_slashes(args.volume), {**level_options(volume), **options.volume_options(args)}),
        labels,
        tuple(DataSource(_use_slashes(path), options) for path, options in further.channel_sources),
    )
    return made, remarks, sidecar_of(made, sources)


def _use_slashes(path) -> str:
    """A path as sidecars keep it, which every system finds."""
    return Path(path).as_posix()


def _render(figure: Figure, qualities, line, *, frames: bool = False):
    """Render a figure; ``frames``: with views that what is visible fills."""
    from ..figure.framing import frame_steps
    from ..figure.make import figure_steps
    from ..pipeline.stage_cache import StageCache

    cache = StageCache()
    with line.compiling():
        if frames:
            figure = line.follow(frame_steps(figure, cache), start=0.1)
        return line.follow(figure_steps(figure, qualities, cache), start=0.1)


# --- the same figure again --------------------------------------------------------------------------------------------


def _make_again(args, line):
    """Make the figure of a sidecar again; return (MadeFigure, remarks, None)."""
    from ..figure.sidecar import figure_of, read_sidecar, same_bits, version_remarks

    given = [name for name in vars(args) if name not in OF_A_REMAKE and getattr(args, name) != args.defaults(name)]
    if given:
        raise RleSplatError(
            f"A figure's sidecar holds all settings, so --{given[0].replace('_', '-')} cannot be given with it; remove "
            "it, or make a new figure of the volume."
        )
    sidecar = read_sidecar(args.volume)
    places = _places(args, sidecar.sources)
    _check_outputs(args, (args.volume, *(place for _, place in places)))
    made = _render(*figure_of(sidecar, _read_again(places, sidecar.sources, line), args.threads), line)
    remarks = [*version_remarks(sidecar), *made.remarks]
    if same_bits(sidecar, made.renderings):
        remarks.append("Its pictures are bit-identical to those of the sidecar.")
    else:
        remarks.append("Its pictures differ from those of the sidecar, which another version or processor made.")
    return made, remarks, None


def _places(args, sources) -> list[tuple]:
    """Each source of a sidecar, the volume's first, then that of the labels, if any, and where its file is now."""
    if args.labels is not None and sources.labels is None:
        raise RleSplatError("The figure of the sidecar shows no labels; remove --labels.")
    if args.channel and len(args.channel) != len(sources.channels):
        raise RleSplatError(
            f"The figure of the sidecar shows {len(sources.channels)} channels and --channel is given "
            f"{len(args.channel)} times; give it once for each, or not at all."
        )
    wanted = [(sources.volume, args.data, "data", "--data")]
    if sources.labels is not None:
        given = args.data if sources.labels.options.get(BODY) else args.labels
        wanted.append((sources.labels, given, "label map", "--labels"))
    now = args.channel or [None] * len(sources.channels)
    wanted += [(source, path, "channel", "--channel") for source, path in zip(sources.channels, now)]
    return [(source, _place(args, source.file, path, what)) for source, path, *what in wanted]


def _place(args, file: str, given, what) -> Path:
    """Where a file of a sidecar is: where an option says, as the sidecar says, or beside the sidecar."""
    if given is not None:
        return Path(given)
    places = (Path(file), Path(args.volume).parent / file, Path(args.volume).parent / Path(file).name)
    found = next((place for place in places if place.exists()), None)
    if found is None:
        name, option = what
        raise RleSplatError(
            f"The {name} of the figure, {file}, is neither there nor beside the sidecar; say where with {option} FILE."
        )
    return found


def _read_again(places: list[tuple], sources, line):
    """Read the files of a sidecar and check that they are those of its figure; return the FigureData."""
    from ..figure.sources import FigureData, check_data

    def read(steps, path):
        line.show(0.0, f"reading {path.name}")
        return line.follow(steps)

    (source, path), *further = places
    volume, labels, channels = read(read_steps(str(path), **source.options), path), None, []
    check_values(volume)
    check_data(source, volume, path)
    if sources.labels is not None:
        (source, path), *further = further
        found_by = map_steps(volume) if source.options.get(BODY) else read_label_steps(path, volume)
        labels = read(found_by, path)
        check_data(source, labels, path)
    for source, path in further:
        channel, _ = read(read_channel_steps(path, volume, source.options), path)
        check_data(source, channel, path)
        channels.append(channel)
    return FigureData(volume, labels, tuple(channels))
