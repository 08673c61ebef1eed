"""Option groups that several commands share, and the plain data made from them."""

import argparse
import re
from dataclasses import asdict

from ..accuracy.planner.candidates import check_tolerance
from ..classify.presets import PRESETS
from ..read.formats import suffixes
from ..read.layout import BYTE_ORDERS
from ..scene import (
    BACKGROUNDS,
    CLASSIFICATIONS,
    DEFAULT_CLASSIFICATION,
    DEFAULT_QUALITY,
    FOOTPRINTS,
    KNOB_TEXTS,
    MINIFICATIONS,
    MODE_TEXTS,
    MODELS,
    MODES,
    NAMED_DEPTH_RULES,
    QUALITY_PRESETS,
    RECORDS,
    WARP_FILTERS,
    Quality,
    RleSplatError,
    as_background,
    not_in_post,
    without_removed,
)
from ..volume.volume import STORED_TYPES

# Option -> (field of Quality, type, values in the help).
KNOBS = {
    "--classification": ("classification", str, "|".join(CLASSIFICATIONS)),
    "--depth-rule": ("depth_rule", str, "|".join((*NAMED_DEPTH_RULES, "midpoint-M", "preintegrated[-M]"))),
    "--sheet-density": ("sheet_density", float, "R"),
    "--kernel": ("kernel", str, "|".join(FOOTPRINTS)),
    "--minification": ("minification", str, "|".join(MINIFICATIONS)),
    "--warp-filter": ("warp_filter", str, "|".join(WARP_FILTERS)),
    "--termination": ("termination", float, "T"),
    "--axis-fade": ("axis_fade", float, "DEGREES"),
    "--rays": ("rays", float, "D"),
    "--model": ("model", str, "|".join(MODELS)),
}
BESIDE = "classification"  # the knob that may be combined with --quality and --tolerance
DEFAULT_SIZE = (512, 512)  # width and height in pixels
BACKGROUND = "|".join(("R G B", *BACKGROUNDS))  # the words of --background
CUSTOM_QUALITY = "custom"  # the name of a quality made from knobs, in reports

EFFECT_STATES = {"on": True, "off": False, "auto": None}

# The keyword arguments of read_volume, by their names in the parsed arguments.
READ_OPTIONS = (
    "shape", "dtype", "byte_order", "header_bytes", "spacing", "slope", "intercept", "grid", "series", "frame", "unit",
    "value_unit", "modality", "orientation", "flip", "level",
)  # fmt: skip


def add_volume_argument(parser, also=()) -> None:
    """Add the volume file; ``also``: further suffixes that only this command reads."""
    parser.add_argument(
        "volume",
        metavar="VOLUME",
        help=f"the file, or the folder of a DICOM series or an OME-Zarr; suffixes: {', '.join((*suffixes(), *also))}",
    )


def add_volume_options(parser) -> None:
    """Add the options for a file that does not describe its own layout."""
    group = parser.add_argument_group(
        "volume options", "taken from the file, or guessed from its name and size, unless given"
    )
    group.add_argument(
        "--shape", nargs=3, type=int, metavar=("NX", "NY", "NZ"), help="number of voxels along x (fastest), y and z"
    )
    group.add_argument("--dtype", metavar="TYPE", help=f"number type of a voxel: {'|'.join(STORED_TYPES)}")
    group.add_argument("--byte-order", metavar="ORDER", help=f"order of a voxel's bytes: {'|'.join(BYTE_ORDERS)}")
    group.add_argument("--header-bytes", type=int, metavar="N", help="bytes to skip before the voxels")
    group.add_argument(
        "--spacing", nargs=3, type=float, metavar=("SX", "SY", "SZ"), help="distance between voxel centers"
    )
    group.add_argument(
        "--orientation", metavar="LETTERS", help="where voxel x, y and z grow in the patient, such as LPS"
    )
    group.add_argument("--flip", metavar="AXES", help="voxel axes to mirror, each once, such as x or xz")
    group.add_argument("--slope", type=float, metavar="A", help="factor A in value = A * stored + B")
    group.add_argument("--intercept", type=float, metavar="B", help="offset B in value = A * stored + B")
    group.add_argument("--grid", metavar="NAME", help="the grid of a .vdb; NAME[1] is the second grid of that name")
    group.add_argument(
        "--series", type=int, metavar="N", help="the series, from 1, where there are several; info lists them"
    )
    group.add_argument(
        "--level", type=int, metavar="N",
        help="the level of an OME-Zarr pyramid, 0 for the finest; default the finest that fits into memory; of other "
        "formats, keep every 2^N-th voxel along each axis, for a quick look")  # fmt: skip
    group.add_argument(
        "--frame",
        type=int,
        metavar="N",
        help="the volume to read, from 1, of several; channels count before time points (default 1)",
    )
    group.add_argument("--unit", metavar="NAME", help="unit of lengths (default mm)")
    group.add_argument("--value-unit", metavar="NAME", help="unit of values, such as HU")
    group.add_argument("--modality", metavar="NAME", help="kind of scanner, such as CT or MR")


def volume_options(args) -> dict:
    """The given options of ``add_volume_options``, as keyword arguments of ``read_volume``."""
    return {name: getattr(args, name) for name in READ_OPTIONS if getattr(args, name) is not None}


def read_input(args, line, **more):
    """Read the volume of a command, with its progress on a ProgressLine; return the Volume.

    ``more``: options of ``read_volume`` beside those of ``add_volume_options``, left out where the format has none.
    """
    from ..read.formats import format_of, read_steps

    if more:
        known = getattr(format_of(args.volume), "options", ())
        more = {name: value for name, value in more.items() if name in known}
    return line.follow(read_steps(args.volume, **volume_options(args), **more))


def add_report_options(parser) -> None:
    """Add the options that every command has."""
    parser.add_argument("--json", metavar="FILE", help="write the report as JSON to FILE")
    parser.add_argument(
        "--progress", action=argparse.BooleanOptionalAction, default=None,
        help="show progress on stderr (default: only on a terminal)",
    )  # fmt: skip
    parser.add_argument(
        "--memory-limit", type=memory_size, metavar="SIZE",
        help="the most memory to take, such as 2GiB or 800MiB; what cannot be made within it gives an error; mapped "
             "files do not count",
    )  # fmt: skip


def add_transfer_function_options(parser) -> None:
    """Add the options of the transfer function."""
    group = parser.add_argument_group("transfer function", "chosen from the volume's values unless given")
    one = group.add_mutually_exclusive_group()
    one.add_argument(
        "--transfer-function",
        metavar="FILE",
        help="a file of RLE Splat or 3D Slicer, or a color map; points of opacity and color (.json), presets of 3D "
        "Slicer (.xml, .mrml, .vp, .vp.json), color maps of niivue (.json) and FSL (.cmap)",
    )
    one.add_argument("--preset", metavar="NAME", help=f"a built-in transfer function: {', '.join(PRESETS)}")
    group.add_argument("--transfer-name", metavar="NAME", help="which transfer function of a file that holds several")
    group.add_argument(
        "--smoothness", type=float, metavar="MM",
        help="how far surfaces are smoothed for light; standard deviation of a Gaussian, 0 for none; default that of "
        "the transfer function, else the largest voxel spacing, at most 2 mm; only with --classification post",
    )  # fmt: skip


def add_light_options(parser) -> None:
    """Add the options of the lights."""
    group = parser.add_argument_group("lights")
    group.add_argument("--lights", metavar="FILE.json", help="lights with the properties of Blender's")
    group.add_argument(
        "--headlight", action=argparse.BooleanOptionalAction, default=None,
        help="a white parallel light along the camera's axis; default for the turntable without --lights",
    )  # fmt: skip
    group.add_argument(
        "--no-shading", action="store_true", help="show the colors of the transfer function without lights"
    )


def _effect_names() -> dict[str, str]:
    """Effects as they are typed, with hyphens, and their names."""
    from ..effects.analyze import EFFECTS

    return {name.replace(" ", "-"): name for name in EFFECTS}


def add_effect_options(parser) -> None:
    """Add the option that forces effects on or off."""
    group = parser.add_argument_group("effects")
    group.add_argument(
        "--effect", action="append", default=[], metavar="NAME=on|off|auto",
        help="force an effect on or off, several times if needed; auto (the default) uses it if the scene needs it; "
        f"names: {', '.join(_effect_names())}",
    )  # fmt: skip


def effects_from(args) -> dict[str, bool]:
    """The overrides of --effect; RleSplatError for an unknown effect or state.

    Returns
    -------
    dict of str to bool
        Name of an effect to its forced state; the last --effect of a name counts.
    """
    names, overrides = _effect_names(), {}
    for given in args.effect:
        name, _, state = given.partition("=")
        if state not in EFFECT_STATES:
            raise RleSplatError(f"--effect is {given!r}; give NAME=on, NAME=off or NAME=auto.")
        typed = re.sub("[ _]", "-", name.strip())
        if typed not in names:
            raise RleSplatError(f"There is no effect called {name!r}; choose {', '.join(names)}.")
        overrides[names[typed]] = EFFECT_STATES[state]
    return {name: on for name, on in overrides.items() if on is not None}


def add_turntable_options(parser) -> None:
    """Add the options of the turntable camera."""
    group = parser.add_argument_group("turntable", "an orthographic view of the volume from the front unless given")
    group.add_argument(
        "--azimuth",
        type=float,
        metavar="DEG",
        help="0 (default) from the front, 90 from the patient's left; degrees about the vertical, 0 along +Y",
    )
    group.add_argument("--elevation", type=float, metavar="DEG", help="degrees above the horizon (default 0)")
    group.add_argument(
        "--fit", type=float, metavar="F",
        help="height of the view as a multiple of the volume's longest side (default 1.25; for figures, what is "
        "visible fills the pictures)")  # fmt: skip
    group.add_argument(
        "--perspective", action="store_true", default=None, help="a perspective view instead of an orthographic one"
    )
    group.add_argument("--fov", type=float, metavar="DEG", help="vertical angle of a perspective view (default 40)")


def add_placement_options(parser) -> None:
    """Add the options of the camera file and of the volume's place."""
    group = parser.add_argument_group("placement")
    group.add_argument(
        "--camera", metavar="FILE.json",
        help="a camera with the properties of Blender's, instead of the turntable")  # fmt: skip
    group.add_argument(
        "--volume-matrix", metavar="FILE.json", help="4x4 matrix from the volume's own space to the world"
    )
    group.add_argument(
        "--scene-scale", type=float, default=1.0, metavar="S", help="world units per volume unit (default 1)"
    )


def add_scene_options(parser) -> None:
    """Add the options that describe a scene: volume, transfer function, lights, effects, view and placement."""
    add_volume_options(parser)
    add_transfer_function_options(parser)
    add_light_options(parser)
    add_effect_options(parser)
    add_turntable_options(parser)
    add_placement_options(parser)


def add_clip_option(parser) -> None:
    """Add the option of clip objects."""
    parser.add_argument(
        "--clip", metavar="FILE.json", help="planes and boxes that cut the volume; a list of {kind, matrix_world, keep}"
    )


def add_mist_option(parser) -> None:
    """Add the option of the mist."""
    parser.add_argument(
        "--mist", metavar="FILE.json", help="mist as in Blender's world: {start, depth, falloff, color}"
    )


def scene_inputs(args) -> tuple:
    """The input files of a command with ``add_scene_options``; None for one that was not given."""
    further = (getattr(args, name, None) for name in ("clip", "mist", "environment"))
    return args.volume, args.transfer_function, args.lights, args.camera, args.volume_matrix, *further


def add_size_option(parser) -> None:
    """Add the option of the image size."""
    parser.add_argument(
        "--size", type=image_size, default=DEFAULT_SIZE, metavar="W [H]", help="image size in pixels (default 512)"
    )


def add_image_options(parser) -> None:
    """Add the options of the image."""
    add_size_option(parser)
    parser.add_argument(
        "--crop", nargs=4, type=int, metavar=("LEFT", "TOP", "RIGHT", "BOTTOM"),
        help="render a part only, in pixels from the top left; RIGHT and BOTTOM are not included",
    )  # fmt: skip
    parser.add_argument(
        "--background", type=lambda text: as_background(background(text)), metavar=BACKGROUND,
        help="behind the picture in a .png (default transparent); scene-linear, or with straight alpha",
    )  # fmt: skip


def add_mode_option(parser) -> None:
    """Add the option of the mode."""
    parser.add_argument(
        "--mode", default=MODES[0], metavar="|".join(MODES),
        help=f"what a pixel shows of its ray (default {MODES[0]}); "
        f"{'; '.join(f'{name}: {text}' for name, text in MODE_TEXTS.items())}",
    )  # fmt: skip


def add_quality_options(parser) -> None:
    """Add the options of the quality, the knobs, and the machine."""
    group = parser.add_argument_group(
        "quality",
        "a named quality, or single settings; --classification may be combined with both "
        f"(default {DEFAULT_CLASSIFICATION}, or pre if a setting needs it)",
    )
    group.add_argument("--quality", metavar="NAME", help=f"{'|'.join(QUALITY_PRESETS)} (default {DEFAULT_QUALITY})")
    group.add_argument("--paper", action="store_true", help="the algorithm as published, classification pre")
    for option, (name, kind, values) in KNOBS.items():
        group.add_argument(option, dest=name, type=kind, metavar=values, help=KNOB_TEXTS[name])
    add_machine_options(parser)


def add_tolerance_options(parser) -> None:
    """Add the options of the tolerance."""
    from ..accuracy.probes import PROBES

    group = parser.add_argument_group(
        "tolerance",
        "instead of a quality; settings are chosen, the error is measured, and finer ones follow if it is too large",
    )
    group.add_argument("--tolerance", type=float, metavar="STEPS", help="largest allowed error, in 8-bit steps, 1/255")
    group.add_argument(
        "--probes", type=int, metavar="N",
        help=f"about how many pixels the error is measured at (default {PROBES}), and up to half as many more where "
        "it is likely to be large; 0 predicts it only",
    )  # fmt: skip


def add_model_option(parser) -> None:
    """Add the model, the only knob that encoded tables depend on."""
    parser.add_argument("--model", metavar="|".join(MODELS), help=f"{KNOB_TEXTS['model']} (default {MODELS[0]})")


def add_machine_options(parser) -> None:
    """Add the options of threads and voxel records."""
    group = parser.add_argument_group("machine")
    group.add_argument(
        "--threads", type=int, default=0, metavar="N", help="number of threads (default 0, all processor cores)"
    )
    group.add_argument(
        "--record", type=int, metavar="BYTES",
        help=f"{'|'.join(map(str, RECORDS))}: {KNOB_TEXTS['record']}",
    )  # fmt: skip


def quality_from(args, usual: str | None = None) -> Quality:
    """The quality from the options; RleSplatError if options contradict each other, or a value is out of range.

    Parameters
    ----------
    args : argparse.Namespace
        With the options of ``add_quality_options``, and of ``add_tolerance_options`` if the command has them.
    usual : str, optional
        The classification if none is given.  Without it, pre if a knob needs it, else the default.
    """
    knobs, _ = without_removed(_list_given_knobs(args))
    machine = {"threads": args.threads, "record": knobs.pop("record", RECORDS[0])}
    if args.quality is not None and args.paper:
        raise RleSplatError("--quality and --paper contradict each other; give one of them.")
    if getattr(args, "tolerance", None) is not None:
        _check_tolerance(args, knobs)
    elif getattr(args, "probes", None) is not None and hasattr(args, "tolerance"):
        raise RleSplatError("--probes has no effect without --tolerance; give --tolerance too.")
    whole = "--paper" if args.paper else "--quality" if args.quality is not None else None
    for option, (name, _, _) in KNOBS.items():
        if whole and name in knobs and (args.paper or name != BESIDE):
            raise RleSplatError(f"{whole} already sets what {option} sets; give one of the two.")
    if args.paper:
        return Quality.paper(**machine)
    classification = knobs.pop(BESIDE, usual)
    if classification is None:
        classification = "pre" if not_in_post({**knobs, **machine}) else _default_classification(args)
    custom = {"name": CUSTOM_QUALITY} if knobs else {}
    return Quality.preset(args.quality or DEFAULT_QUALITY, classification, **knobs, **machine, **custom)


def _list_given_knobs(args) -> dict:
    """Field of Quality -> value, of those knobs that the command has and that are given, and the record."""
    names = (*(name for name, _, _ in KNOBS.values()), "record")
    return {name: value for name in names if (value := getattr(args, name, None)) is not None}


def _default_classification(args) -> str:
    """The classification if none is given; with a tolerance, one that the planner supports."""
    if getattr(args, "tolerance", None) is None:
        return DEFAULT_CLASSIFICATION
    from ..pipeline.plan_model import default_classification

    return default_classification()


def remark_on_removed(args) -> tuple[str, ...]:
    """A remark for the report for each value of an option that is given and was removed."""
    return without_removed(_list_given_knobs(args))[1]


def quality_remarks(args, quality: Quality) -> tuple[str, ...]:
    """Remarks for the report on what was removed, and on a classification that a knob has changed.

    ``quality``: the result of ``quality_from``.
    """
    removed, of_pre = remark_on_removed(args), not_in_post(asdict(quality))
    if args.classification is not None or args.paper or not of_pre:
        return removed
    option, value = f"--{of_pre[0]}", getattr(quality, of_pre[0])
    return (
        *removed,
        f"Classified by {quality.classification}, because {DEFAULT_CLASSIFICATION} does not support {option} {value}.",
    )


def _check_tolerance(args, knobs) -> None:
    """Refuse an invalid tolerance, and options that it sets itself."""
    check_tolerance(args.tolerance)
    if args.probes is not None and args.probes < 0:
        raise RleSplatError(f"--probes is {args.probes}; give a number of pixels that is not below zero.")
    given = [option for option, (name, _, _) in KNOBS.items() if name in knobs and name != BESIDE]
    given += ["--quality"] * (args.quality is not None) + ["--paper"] * args.paper
    if given:
        raise RleSplatError(f"--tolerance chooses what {given[0]} sets; give one of the two.")


def encoding_quality(args) -> Quality:
    """The knobs that encoding depends on: classification, model, record and threads."""
    knobs, _ = without_removed(_list_given_knobs(args))
    return Quality(**knobs, threads=args.threads)


def memory_size(text: str) -> int:
    """Bytes from a number with a unit, such as 2GiB; powers of 1024."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([KMGT])i?B?", text.strip(), re.IGNORECASE)
    if not found or not float(found[1]) > 0.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a size such as 2GiB or 800MiB")
    return round(float(found[1]) * 1024 ** (1 + "KMGT".index(found[2].upper())))


def background(text: str) -> str | tuple | None:
    """A name, or scene-linear RGB from ``R,G,B``."""
    color = as_background(text.split(",") if "," in text else text)
    return text if text in BACKGROUNDS else color


def image_size(text: str) -> tuple[int, int]:
    """Width and height from ``W`` or ``WxH``."""
    try:
        sides = [int(side) for side in text.split("x")]
    except ValueError:
        sides = []
    if len(sides) not in (1, 2):
        raise argparse.ArgumentTypeError(f"{text!r} is not one or two whole numbers of pixels")
    return sides[0], sides[-1]
