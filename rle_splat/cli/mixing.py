"""Labels and channels from the options."""

from __future__ import annotations

from dataclasses import replace

from ..classify.label_styles import labels_of, read_label_styles
from ..classify.transfer_function import TransferFunction
from ..scene import Channel, RleSplatError, Scene


def add_mixing_options(parser) -> None:
    """Add the options of labels and channels."""
    group = parser.add_argument_group(
        "labels and channels", "further volumes on the same grid; they are rendered pre-classified")
    group.add_argument("--labels", metavar="FILE", help="a label map: a volume of whole numbers")
    group.add_argument(
        "--label-functions", metavar="FILE.json",
        help="the colors and transfer functions of the labels: a list of {label, name, hidden, color, preset, "
        "transfer_function}",
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
    styles : tuple of LabelStyle
        The appearance of the labels.
    functions : tuple of TransferFunction
        The transfer functions of the channels.

    Raises
    ------
    RleSplatError
        If an option is missing its counterpart, or a file is bad.
    """
    if (args.labels is None) != (args.label_functions is None):
        raise RleSplatError("--labels and --label-functions need each other; give both.")
    if len(args.channel) != len(args.channel_function):
        raise RleSplatError(
            f"There are {len(args.channel)} --channel and {len(args.channel_function)} --channel-function; give each "
            "channel its function."
        )
    styles = () if args.label_functions is None else read_label_styles(args.label_functions)
    return styles, tuple(TransferFunction.from_json(path) for path in args.channel_function)


def mixed(args, scene: Scene, styles, functions) -> Scene:
    """Add the labels and channels of the options to a scene.

    Parameters
    ----------
    args : argparse.Namespace
        With ``labels`` and ``channel``.
    scene : Scene
        The scene.
    styles, functions
        The results of ``read_mixing``.

    Returns
    -------
    Scene
        The scene with labels and channels.
    """
    if args.labels is not None:
        labels = labels_of(_read_beside(scene, args.labels), styles, scene.volume, scene.transfer_function)
        scene = replace(scene, labels=labels)
    channels = zip(args.channel, functions, strict=True)
    return replace(scene, channels=tuple(Channel(_read_beside(scene, path), function) for path, function in channels))


def _read_beside(scene: Scene, path):
    """Read a volume; a raw file is read with the shape of the scene's volume."""
    from ..read.formats import format_of, read_volume

    kind = format_of(path)
    shape = scene.volume.shape_xyz if kind is not None and "shape" in kind.options else None
    return read_volume(path, shape=shape)
