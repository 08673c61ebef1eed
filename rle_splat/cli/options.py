"""Option groups that several commands share, and what becomes of them."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from ..accuracy.planner.candidates import check_tolerance
from ..read.formats import suffixes
from ..read.layout import BYTE_ORDERS
from ..scene import (
    BACKENDS,
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
    REFINEMENTS,
    WARP_FILTERS,
    Quality,
    RleSplatError,
    not_in_post,
)
from ..volume.volume import STORED_TYPES

# One table of knobs: option -> (field of Quality, how to read it, how the help names its values).
KNOBS = {
    "--classification": ("classification", str, "|".join(CLASSIFICATIONS)),
    "--refinement": ("refinement", int, "|".join(map(str, REFINEMENTS))),
    "--depth-rule": ("depth_rule", str, "|".join((*NAMED_DEPTH_RULES, "midpoint-M"))),
    "--sheet-density": ("sheet_density", float, "R"),
    "--kernel": ("kernel", str, "|".join(FOOTPRINTS)),
    "--minification": ("minification", str, "|".join(MINIFICATIONS)),
    "--warp-filter": ("warp_filter", str, "|".join(WARP_FILTERS)),
    "--termination": ("termination", float, "T"),
    "--axis-fade": ("axis_fade", float, "DEGREES"),
    "--rays": ("rays", float, "D"),
    "--model": ("model", str, "|".join(MODELS)),
}
BESIDE = ("classification", "refinement")  # knobs that a quality and a tolerance leave to the user
DEFAULT_SIZE = (512, 512)  # pixels, width and height
CUSTOM_QUALITY = "custom"  # the name of a quality put together from knobs, as reports show it

EFFECT_STATES = {"on": True, "off": False, "auto": None}

# The options of read_volume, each by its name in the parsed arguments.
READ_OPTIONS = (
    "shape", "dtype", "byte_order", "header_bytes", "spacing", "slope", "intercept", "grid", "unit", "value_unit",
    "modality",
)


def add_volume_argument(parser, also=()) -> None:
    """The file to read; ``also`` are suffixes that only this command reads."""
    parser.add_argument("volume", metavar="VOLUME", help=f"the file to read: {', '.join((*suffixes(), *also))}")


def add_volume_options(parser) -> None:
    """How to read a file that does not say what it is."""
    group = parser.add_argument_group("volume options", "guessed from the file's name and size where left out")
    group.add_argument("--shape", nargs=3, type=int, metavar=("NX", "NY", "NZ"), help="voxels along x (fastest), y, z")
    group.add_argument("--dtype", metavar="TYPE", help=f"{'|'.join(STORED_TYPES)}")
    group.add_argument("--byte-order", metavar="ORDER", help="|".join(BYTE_ORDERS))
    group.add_argument("--header-bytes", type=int, metavar="N", help="bytes to skip before the voxels")
    group.add_argument("--spacing", nargs=3, type=float, metavar=("SX", "SY", "SZ"), help="between voxel centers")
    group.add_argument("--slope", type=float, metavar="A", help="physical value = A * stored + B")
    group.add_argument("--intercept", type=float, metavar="B", help="physical value = A * stored + B")
    group.add_argument("--grid", metavar="NAME", help="the grid of a .vdb; NAME[1] for the second of that name")
    group.add_argument("--unit", metavar="NAME", help="what lengths are in (mm)")
    group.add_argument("--value-unit", metavar="NAME", help="what values are in, such as HU")
    group.add_argument("--modality", metavar="NAME", help="how it was measured, such as CT or MR")


def volume_options(args) -> dict:
    """The options of read_volume that were given, by its names; it checks their values."""
    return {name: getattr(args, name) for name in READ_OPTIONS if getattr(args, name) is not None}


def add_report_options(parser) -> None:
    """What every command offers beside its own work."""
    parser.add_argument("--json", metavar="FILE", help="write the machine-readable report to FILE")
    parser.add_argument(
        "--progress", action=argparse.BooleanOptionalAction, default=None,
        help="show progress on stderr (by default where it is a terminal)",
    )


def add_transfer_function_options(parser) -> None:
    group = parser.add_argument_group("transfer function", "chosen from the volume's values where left out")
    one = group.add_mutually_exclusive_group()
    one.add_argument("--transfer-function", metavar="FILE.json", help="points of opacity and color")
    one.add_argument("--preset", metavar="NAME", help="a built-in one; an unknown name lists them")


def add_light_options(parser) -> None:
    group = parser.add_argument_group("lights")
    group.add_argument("--lights", metavar="FILE.json", help="a list of lights, each as in Blender")
    group.add_argument(
        "--headlight", action=argparse.BooleanOptionalAction, default=None,
        help="one white parallel light along the camera's axis (the turntable's default without --lights)",
    )
    group.add_argument("--no-shading", action="store_true", help="the transfer function's colors as they are")


def add_effect_options(parser) -> None:
    group = parser.add_argument_group("effects")
    group.add_argument(
        "--effect", action="append", default=[], metavar="NAME=on|off|auto",
        help="force an effect on or off instead of as the scene calls for it; may be given several times; an unknown "
        "name lists them",
    )


def effects_from(args) -> dict[str, bool]:
    """The overrides of --effect, name -> forced on or off; the last word on a name counts."""
    from ..effects.analyse import check_overrides

    overrides = {}
    for given in args.effect:
        name, _, state = given.partition("=")
        if state not in EFFECT_STATES:
            raise RleSplatError(f"--effect takes NAME=on, NAME=off or NAME=auto, not {given!r}.")
        overrides[name.strip().replace("_", " ").replace("-", " ")] = EFFECT_STATES[state]
    return {name: on for name, on in check_overrides(overrides).items() if on is not None}


def add_turntable_options(parser) -> None:
    group = parser.add_argument_group("turntable", "an orthographic view of the volume from the front where left out")
    group.add_argument("--azimuth", type=float, metavar="DEG", help="0 (default) looks along +Y")
    group.add_argument("--elevation", type=float, metavar="DEG", help="0 (default) is level, 90 looks straight down")
    group.add_argument("--fit", type=float, metavar="F", help="height of the view over the largest side (1.25)")
    group.add_argument("--perspective", action="store_true", default=None, help="instead of orthographic")
    group.add_argument("--fov", type=float, metavar="DEG", help="vertical angle of a perspective view (40)")


def add_placement_options(parser) -> None:
    group = parser.add_argument_group("placement")
    group.add_argument("--camera", metavar="FILE.json", help="a camera as Blender has it, instead of the turntable")
    group.add_argument("--volume-matrix", metavar="FILE.json", help="4x4, the volume's own space to the world")
    group.add_argument("--scene-scale", type=float, default=1.0, metavar="S", help="world units per volume unit (1)")


def add_scene_options(parser) -> None:
    """What makes a scene of a volume: how it is read, its look, its lights, the view and its place."""
    add_volume_options(parser)
    add_transfer_function_options(parser)
    add_light_options(parser)
    add_effect_options(parser)
    add_turntable_options(parser)
    add_placement_options(parser)


def add_clip_option(parser) -> None:
    parser.add_argument(
        "--clip", metavar="FILE.json", help="planes and boxes that cut the volume: a list of {kind, matrix_world, keep}"
    )


def add_mist_option(parser) -> None:
    parser.add_argument("--mist", metavar="FILE.json", help="as in Blender's world: {start, depth, falloff, color}")


def scene_inputs(args) -> tuple:
    """The files that a command with the options of a scene reads; None for each that was not given."""
    clip = getattr(args, "clip", None)
    return args.volume, args.transfer_function, args.lights, args.camera, args.volume_matrix, clip


def add_size_option(parser) -> None:
    parser.add_argument("--size", type=image_size, default=DEFAULT_SIZE, metavar="W [H]", help="pixels (512)")


def add_image_options(parser) -> None:
    add_size_option(parser)
    parser.add_argument(
        "--crop", nargs=4, type=int, metavar=("LEFT", "TOP", "RIGHT", "BOTTOM"),
        help="make only these pixels of the picture, from 0 at the top left; RIGHT and BOTTOM are the first left out",
    )
    parser.add_argument(
        "--background", nargs=3, type=float, metavar=("R", "G", "B"),
        help="scene-linear, under the picture of a .png; left out, a .png has straight alpha",
    )


def add_mode_option(parser) -> None:
    parser.add_argument(
        "--mode", default=MODES[0], metavar="|".join(MODES),
        help=f"what a pixel shows of its ray: {', '.join(MODE_TEXTS.values())} (default {MODES[0]})",
    )


def add_quality_options(parser) -> None:
    group = parser.add_argument_group(
        "quality",
        f"one of --quality, --paper, or the knobs; --classification goes with --quality and with the knobs, and is "
        f"{DEFAULT_CLASSIFICATION} where it is left out and no knob is of pre alone",
    )
    group.add_argument("--quality", metavar="NAME", help=f"{'|'.join(QUALITY_PRESETS)} (default {DEFAULT_QUALITY})")
    group.add_argument("--paper", action="store_true", help="the paper's literal pipeline, classification pre")
    for option, (name, kind, values) in KNOBS.items():
        group.add_argument(option, dest=name, type=kind, metavar=values, help=KNOB_TEXTS[name])
    add_machine_options(parser)


def add_tolerance_options(parser) -> None:
    """A wish in place of a quality."""
    from ..accuracy.probes import PROBES

    group = parser.add_argument_group(
        "tolerance", "in place of a quality: the plan is chosen, measured, and made finer where it does not keep it"
    )
    group.add_argument(
        "--tolerance", type=float, metavar="LEVELS", help="largest error of any channel, in 1/255 of full scale"
    )
    group.add_argument(
        "--probes", type=int, metavar="N", help=f"pixels held against the truth ({PROBES}); 0 for a prediction alone"
    )


def add_model_option(parser) -> None:
    """The one knob of quality that tables are made for."""
    parser.add_argument("--model", metavar="|".join(MODELS), help=f"{KNOB_TEXTS['model']} (default {MODELS[0]})")


def add_machine_options(parser) -> None:
    group = parser.add_argument_group("machine")
    group.add_argument("--threads", type=int, default=0, metavar="N", help="0 (default): one per core")
    group.add_argument(
        "--record", type=int, metavar="BYTES",
        help=f"{'|'.join(map(str, RECORDS))}: {KNOB_TEXTS['record']}",
    )
    group.add_argument("--backend", default="auto", metavar="|".join(BACKENDS), help=KNOB_TEXTS["backend"])


def quality_from(args, usual: str | None = None) -> Quality:
    """The Quality asked for; a RleSplatError when the options contradict each other.

    ``usual``: the classification that is meant where none is given; left out, the default, or pre where a knob has a
    value that post does not have.
    """
    knobs = {name: getattr(args, name) for name, _, _ in KNOBS.values() if getattr(args, name) is not None}
    machine = {"threads": args.threads, "backend": args.backend, "record": record_from(args)}
    if args.quality is not None and args.paper:
        raise RleSplatError("--quality and --paper contradict each other; give one of them.")
    if getattr(args, "tolerance", None) is not None:
        _check_tolerance(args, knobs)
    elif getattr(args, "probes", None) is not None and hasattr(args, "tolerance"):
        raise RleSplatError("--probes is how many pixels a tolerance is measured at; give --tolerance too.")
    whole = "--paper" if args.paper else "--quality" if args.quality is not None else None
    for option, (name, _, _) in KNOBS.items():
        if whole and name in knobs and (args.paper or name not in BESIDE):
            raise RleSplatError(f"{whole} already sets what {option} sets; give one of the two.")
    if args.paper:
        return Quality.paper(**machine)
    beside = {name: knobs.pop(name) for name in BESIDE if name in knobs}
    if "refinement" in beside and beside.get("classification") != "refined":
        raise RleSplatError("--refinement is of the refined grid; give --classification refined too, or leave it out.")
    if "classification" not in beside:
        of_pre = not_in_post({**knobs, **machine})
        beside["classification"] = usual or ("pre" if of_pre else _default_classification(args))
    custom = {"name": CUSTOM_QUALITY} if knobs else {}
    return Quality.preset(args.quality or DEFAULT_QUALITY, **beside, **knobs, **machine, **custom)


def _default_classification(args) -> str:
    """What is meant by itself: for a tolerance only what can be promised."""
    if getattr(args, "tolerance", None) is None:
        return DEFAULT_CLASSIFICATION
    from ..accuracy.planner.model import default_classification

    return default_classification()


def quality_remarks(args, quality: Quality) -> tuple[str, ...]:
    """What a report says of a quality that is not the usual one by itself, on account of ``args``."""
    of_pre = not_in_post(asdict(quality))
    if args.classification is not None or args.paper or not of_pre:
        return ()
    option, value = f"--{of_pre[0]}", getattr(quality, of_pre[0])
    return (f"Classified by {quality.classification}, for {option} {value} is not of {DEFAULT_CLASSIFICATION}.",)


def _check_tolerance(args, knobs) -> None:
    """Refuse a tolerance that is none, and what it decides by itself."""
    check_tolerance(args.tolerance)
    if args.probes is not None and args.probes < 0:
        raise RleSplatError("--probes takes a whole number of pixels, not below zero.")
    given = [option for option, (name, _, _) in KNOBS.items() if name in knobs and name not in BESIDE]
    given += ["--quality"] * (args.quality is not None) + ["--paper"] * args.paper
    if given:
        raise RleSplatError(f"--tolerance chooses the plan, and {given[0]} sets it; give one of the two.")


def encoding_quality(args) -> Quality:
    """The Quality that matters to encoding: the model, the record, and what does the work."""
    return Quality(
        classification="pre", model=args.model or MODELS[0], threads=args.threads, backend=args.backend,
        record=record_from(args),
    )


def record_from(args) -> int:
    """Bytes of a voxel's record; --record is no knob of a quality, so that it goes with any of them."""
    return RECORDS[0] if args.record is None else args.record


def image_size(text: str) -> tuple[int, int]:
    """Width and height from ``W`` or ``WxH``."""
    try:
        sides = [int(side) for side in text.split("x")]
    except ValueError:
        sides = []
    if len(sides) not in (1, 2):
        raise argparse.ArgumentTypeError(f"{text!r} is not one or two whole numbers of pixels")
    return sides[0], sides[-1]
