"""Labels and channels from the options."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..classify.label_styles import LabelStyle, labels_of, read_label_styles
from ..classify.transfer_function import TransferFunction
from ..read.labels import TEXT_SUFFIXES, read_label_steps, read_label_text
from ..scene import Channel, RleSplatError, Scene
from ..volume.regrid import on_grid_steps

LABEL_EDGES = ("smooth", "voxels")


def add_mixing_options(parser) -> None:
    """Add the options of labels and channels."""
    group = parser.add_argument_group(
        "labels and channels", "further volumes on the same grid; they are rendered pre-classified")
    group.add_argument("--labels", metavar="FILE", help="a label map: a volume of whole numbers, or a folder of masks")
    group.add_argument(
        "--label-functions", metavar="FILE.json",
        help="the colors and transfer functions of the labels: a list of {label, name, hidden, color, preset, "
        "transfer_function}, or a label description of ITK-SNAP (.txt, .label); without it, the names and colors in "
        "the label file",
    )
    group.add_argument(
        "--label-edges", choices=LABEL_EDGES, default=LABEL_EDGES[0],
        help="smooth edges of labels (default), or voxels, which show the steps of the label map as it is",
    )
    group.add_argument(
        "--channel", action="append", default=[], metavar="FILE",
        help="a volume to add to the picture; may be given several times",
    )
    group.add_argument(
        "--channel-function", action="append", default=[], metavar="FILE.json",
        help="the transfer function of a channel; give one for each --channel, in the same order",
    )


def mixing_inputs(args) -> tuple:
    """The input files of these options; None for one that was not given."""
    return args.labels, args.label_functions, *args.channel, *args.channel_function


def read_mixing(args) -> tuple[tuple, tuple]:
    """Read the JSON files of the options, and check the options, before any volume is read.

    Parameters
    ----------
    args : argparse.Namespace
        With ``labels``, ``label_functions``, ``channel`` and ``channel_function``.

    Returns
    -------
    styles : tuple of LabelStyle or None
        The appearance of the labels; None for that which the label file names.
    functions : tuple of TransferFunction
        The transfer functions of the channels.

    Raises
    ------
    RleSplatError
        If an option is missing its counterpart, or a file is bad.
    """
    if args.labels is None and args.label_functions is not None:
        raise RleSplatError("--label-functions needs --labels; give both.")
    if len(args.channel) != len(args.channel_function):
        raise RleSplatError(
            f"There are {len(args.channel)} --channel and {len(args.channel_function)} --channel-function; give each "
            "channel its function."
        )
    return _read_styles(args.label_functions), tuple(TransferFunction.from_json(path) for path in args.channel_function)


def _read_styles(path) -> tuple | None:
    """The styles in a JSON file, or in a text file of ITK-SNAP; None without a file."""
    if path is None:
        return None
    if Path(path).suffix.lower() in TEXT_SUFFIXES:
        return tuple(LabelStyle(one.label, one.name, not seen, one.color) for one, seen in read_label_text(path))
    return read_label_styles(path)


def _named_styles(path, labels) -> tuple:
    """The styles of the labels that a label file names."""
    if not labels.named_labels:
        raise RleSplatError(f"{Path(path).name} does not name its labels; give their colors with --label-functions.")
    return tuple(LabelStyle(one.label, one.name, color=one.color) for one in labels.named_labels)


def mixed(args, scene: Scene, styles, functions, line) -> tuple[Scene, tuple]:
    """Add the labels and channels of the options to a scene.

    Parameters
    ----------
    args : argparse.Namespace
        With ``labels``, ``label_edges`` and ``channel``.
    scene : Scene
        The scene.
    styles, functions
        The results of ``read_mixing``.
    line : ProgressLine

    Returns
    -------
    scene : Scene
        The scene with labels and channels.
    remarks : tuple of str
        What was noticed about these files.
    """
    remarks = ()
    if args.labels is not None:
        found = line.follow(read_label_steps(args.labels, scene.volume))
        if styles is None:
            styles = _named_styles(args.labels, found)
        smooth = args.label_edges == LABEL_EDGES[0]
        scene = replace(scene, labels=labels_of(found, styles, scene.volume, scene.transfer_function, smooth))
        remarks = found.remarks
    channels = []
    for path, function in zip(args.channel, functions, strict=True):
        found = line.follow(_beside_steps(scene.volume, path))
        channels.append(Channel(found, function))
        remarks = (*remarks, *found.remarks)
    return replace(scene, channels=tuple(channels)), remarks


def _beside_steps(volume, path):
    """Generator of Progress: read a channel onto the grid of a volume; a raw file is read with its shape."""
    from ..read.formats import format_of, read_steps

    kind = format_of(path)
    shape = volume.shape_xyz if kind is not None and "shape" in kind.options else None
    found = yield from read_steps(path, shape=shape)
    return (yield from on_grid_steps(found, volume, values=True))
