"""Labels and channels from the options."""

from __future__ import annotations

from dataclasses import replace

from ..classify.label_styles import labels_of, read_label_styles
from ..classify.transfer_function import TransferFunction
from ..scene import Channel, RleSplatError, Scene


def add_mixing_options(parser) -> None:
    group = parser.add_argument_group("labels and channels", "further volumes on the same grid; rendered by pre")
    group.add_argument("--labels", metavar="FILE", help="a volume of whole numbers: what each voxel belongs to")
    group.add_argument(
        "--label-functions", metavar="FILE.json",
        help="what labels look like: a list of {label, name, hidden, color, preset, transfer_function}",
    )
    group.add_argument(
        "--channel", action="append", default=[], metavar="FILE", help="another channel; may be given several times"
    )
    group.add_argument(
        "--channel-function", action="append", default=[], metavar="FILE.json",
        help="the transfer function of a channel, in the order of the channels",
    )


def mixing_inputs(args) -> tuple:
    """The files that the options name."""
    return args.labels, args.label_functions, *args.channel, *args.channel_function


def read_looks(args) -> tuple[tuple, tuple]:
    """(looks of labels, transfer functions of channels); what can be refused is, before any volume is read."""
    if (args.labels is None) != (args.label_functions is None):
        raise RleSplatError("--labels is the labels' volume and --label-functions what they look like; give both.")
    if len(args.channel) != len(args.channel_function):
        raise RleSplatError(
            f"There are {len(args.channel)} of --channel and {len(args.channel_function)} of --channel-function; give "
            "each channel its function."
        )
    looks = () if args.label_functions is None else read_label_styles(args.label_functions)
    return looks, tuple(TransferFunction.from_json(path) for path in args.channel_function)


def mixed(args, scene: Scene, looks, functions) -> Scene:
    """The scene with the labels and channels of the options, and what ``read_looks`` made of them."""
    if args.labels is not None:
        labels = labels_of(_read_beside(scene, args.labels), looks, scene.volume, scene.transfer_function)
        scene = replace(scene, labels=labels)
    channels = zip(args.channel, functions, strict=True)
    return replace(scene, channels=tuple(Channel(_read_beside(scene, path), function) for path, function in channels))


def _read_beside(scene: Scene, path):
    """The volume at ``path``; bare voxels are on the grid of the scene's volume."""
    from ..read.formats import format_of, read_volume

    kind = format_of(path)
    shape = scene.volume.shape_xyz if kind is not None and "shape" in kind.options else None
    return read_volume(path, shape=shape)
