"""Labels and channels from the options."""

from dataclasses import dataclass, replace
from pathlib import Path

from ..classify.default import default_channel_function_steps
from ..classify.label_styles import LabelStyle, read_label_styles, style_labels
from ..classify.presets import PRESETS, fit_preset_steps
from ..classify.transfer_files import fit_function
from ..classify.transfer_function import TransferFunction
from ..read.channels import MOST_CHANNELS, level_options, read_channel_steps
from ..read.labels import TEXT_SUFFIXES, changes_with_time, read_label_steps, read_label_text, remarks_beside
from ..runtime.steps import drain
from ..scene import Channel, Labels, RleSplatError, Scene
from ..segment.body import body_labels_steps
from ..volume.volume import Volume
from .options import volume_options

LABEL_EDGES = ("smooth", "voxels")
TABLE_HIDDEN = "What lies beside the body, such as a table, is hidden; --keep-table shows it."


def add_mixing_options(parser) -> None:
    """Add the options of labels and channels."""
    group = parser.add_argument_group("segments and channels", "further volumes of the same place")
    group.add_argument("--labels", metavar="FILE", help="a label map, or a folder of masks")
    group.add_argument(
        "--label-functions",
        metavar="FILE.json",
        help="colors and transfer functions of the segments; a list of {label, name, hidden, color, preset, "
        "transfer_function, opacity, solid}, or a label description of ITK-SNAP (.txt, .label); without it, the names "
        "and colors in the label file, or distinct colors if it has none",
    )
    group.add_argument(
        "--label-edges", choices=LABEL_EDGES, default=LABEL_EDGES[0], metavar="|".join(LABEL_EDGES),
        help="smooth edges of segments (default), or voxels, which show the steps of the label map as it is",
    )  # fmt: skip
    group.add_argument(
        "--channel", action="append", default=[], metavar="FILE",
        help="a volume to add to the picture; may be given several times",
    )  # fmt: skip
    group.add_argument(
        "--file-channels",
        action="store_true",
        help="add the other channels in the file of the volume, each in its color and with a window of its own",
    )
    group.add_argument(
        "--channel-function", action="append", default=[], metavar="FILE.json|PRESET",
        help="the transfer function of a channel, a file or a preset; give one for each --channel, in the same order, "
        "or none for automatic ones",
    )  # fmt: skip
    group.add_argument(
        "--keep-table",
        action="store_true",
        help="show the table or the head holder of a CT; without this, --labels, --tolerance or, for a figure, "
        "--compare it is hidden if at least 0.6%% of the voxels shown lie beside the body",
    )


def hide_table(args, volume: Volume, function: TransferFunction, line) -> tuple[Labels | None, tuple[str, ...]]:
    """Labels that hide what lies beside the body, and a sentence that says so; None and () where nothing is hidden.

    A tolerance cannot be met with labels, so a table stays where one is given.
    """
    if args.keep_table or args.labels or getattr(args, "tolerance", None):
        return None, ()
    labels = line.follow(body_labels_steps(volume, function))
    return labels, () if labels is None else (TABLE_HIDDEN,)


def mixing_inputs(args) -> tuple:
    """The input files of these options; None for one that was not given."""
    functions = [name for name in args.channel_function if name not in PRESETS]
    return args.labels, args.label_functions, *args.channel, *functions


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
    functions : tuple of TransferFunction or str
        The transfer functions of the channels, or names of presets; empty for automatic ones.

    Raises
    ------
    RleSplatError
        If an option is missing its counterpart, or a file is bad.
    """
    if args.labels is None and args.label_functions is not None:
        raise RleSplatError("--label-functions needs --labels; give both.")
    if len(args.channel_function) not in (0, len(args.channel)):
        raise RleSplatError(
            f"There are {len(args.channel)} --channel and {len(args.channel_function)} --channel-function; give each "
            "channel its function, or none."
        )
    functions = (name if name in PRESETS else TransferFunction.from_json(name) for name in args.channel_function)
    return _read_styles(args.label_functions), tuple(functions)


def _read_styles(path) -> tuple | None:
    """The styles in a JSON file, or in a text file of ITK-SNAP; None without a file."""
    if path is None:
        return None
    if Path(path).suffix.lower() in TEXT_SUFFIXES:
        return tuple(LabelStyle(one.label, one.name, not seen, one.color) for one, seen in read_label_text(path))
    return read_label_styles(path)


@dataclass(frozen=True, eq=False)
class Further:
    """Labels and channels that were read, on the grid of a volume.

    Attributes
    ----------
    channels : tuple of Volume
    channel_sources : tuple of (str, dict)
        Path of each channel, and options of ``read_volume`` by which it is read again.
    """

    labels: Volume | None = None
    channels: tuple = ()
    channel_sources: tuple = ()

    remarks: tuple[str, ...] = ()


def read_further(args, volume, line) -> Further:
    """Read the labels and channels of the options, with progress on a ProgressLine; ``volume``: the scene's."""
    labels = None if args.labels is None else line.follow(read_label_steps(args.labels, volume))
    if labels is not None and args.frame and changes_with_time(labels):
        labels = line.follow(read_label_steps(args.labels, volume, min(args.frame, labels.frames)))
    sources = [(path, None) for path in args.channel] + (_file_channels(args, volume) if args.file_channels else [])
    found = [line.follow(read_channel_steps(path, volume, options)) for path, options in sources]
    again = ((path, options) for (path, _), (_, options) in zip(sources, found))
    remarks = () if labels is None else remarks_beside(labels, volume.frames if volume.frame_axis == "time" else 1)
    remarks += tuple(remark for channel, _ in found for remark in channel.remarks)
    return Further(labels, tuple(channel for channel, _ in found), tuple(again), remarks)


def _file_channels(args, volume: Volume) -> list:
    """Path and options of each other channel in the file of the volume."""
    name = Path(args.volume).name
    if volume.frames == 1 or volume.frame_axis == "time":
        raise RleSplatError(f"{name} holds no further channels; leave --file-channels out.")
    if volume.frames > MOST_CHANNELS:
        raise RleSplatError(f"{name} holds {volume.frames} volumes; at most {MOST_CHANNELS} can be shown as channels.")
    options = {**level_options(volume), **volume_options(args)}
    shown = options.get("frame") or 1
    return [(args.volume, {**options, "frame": n}) for n in range(1, volume.frames + 1) if n != shown]


def mix(args, scene: Scene, mixing: tuple, further: Further) -> Scene:
    """Add labels and channels to a scene.

    Parameters
    ----------
    args : argparse.Namespace
        With ``labels`` and ``label_edges``.
    mixing : tuple
        The result of ``read_mixing``.
    further : Further
        The result of ``read_further``.
    """
    styles, functions = mixing
    labels = None
    if further.labels is not None:
        smooth = args.label_edges == LABEL_EDGES[0]
        labels = style_labels(further.labels, scene.volume, scene.transfer_function, styles, smooth)
    given = functions + (None,) * (len(further.channels) - len(functions))
    channels = tuple(Channel(one, _function_of(one, name)) for one, name in zip(further.channels, given))
    return replace(scene, labels=labels, channels=channels)


def _function_of(channel: Volume, given) -> TransferFunction:
    """The transfer function of a channel, from a TransferFunction, the name of a preset, or None for automatic."""
    if isinstance(given, TransferFunction):
        return fit_function(given, channel)
    found, _ = drain(default_channel_function_steps(channel) if given is None else fit_preset_steps(given, channel))
    return found
