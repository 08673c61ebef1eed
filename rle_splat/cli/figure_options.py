"""The options of ``rle-splat figure``, and the panels that they ask for."""

from argparse import Namespace
from dataclasses import dataclass, replace
from pathlib import Path

from ..classify.presets import PRESETS, preset
from ..figure.directions import view_name
from ..figure.names import names_of
from ..figure.plan import AUTO, CENTER, OFF, SIDES, FigureStyle, Panel
from ..scene import RleSplatError
from .appearance import choose_transfer_function
from .options import BACKGROUND, background
from .viewing import TURNTABLE_DEFAULTS

DEFAULT = FigureStyle()


def add_figure_options(parser) -> None:
    """Add the options of the page, and those of panels that are compared."""
    page = parser.add_argument_group("page")
    page.add_argument(
        "--width-cm", type=float, default=DEFAULT.width_cm, metavar="CM",
        help=f"width of the figure (default {DEFAULT.width_cm:g})")  # fmt: skip
    page.add_argument(
        "--dpi", type=float, default=DEFAULT.dpi, metavar="N", help=f"pixels per inch (default {DEFAULT.dpi:g})"
    )
    page.add_argument(
        "--aspect", type=float, metavar="R",
        help="width of a picture over its height (default: of what is visible; with --fit or --camera 1)")  # fmt: skip
    page.add_argument("--columns", type=int, default=DEFAULT.columns, metavar="N",
                      help="pictures side by side (default: a square grid, or one column more than rows)")  # fmt: skip
    page.add_argument(
        "--background", type=background, default=DEFAULT.background, metavar=BACKGROUND,
        help=f"of the figure (default {DEFAULT.background}); numbers are scene-linear")  # fmt: skip
    page.add_argument(
        "--font-size", type=float, default=DEFAULT.font_size, metavar="PT",
        help=f"size of the lettering in points (default {DEFAULT.font_size:g})")  # fmt: skip
    page.add_argument("--caption", metavar="TEXT", help="below the pictures (default: what is seen); '' for none")
    page.add_argument(
        "--scale-bar",
        type=_length,
        default=DEFAULT.scale_bar,
        metavar=f"{AUTO}|{OFF}|MM",
        help=f"length of the scale bar in mm, or in the volume's unit if that is no metric one (default {AUTO})",
    )
    page.add_argument(
        "--scale-depth",
        type=_length,
        metavar=f"{CENTER}|D",
        help="distance from the camera, in world units, at which the scale bar of a perspective view holds",
    )
    page.add_argument(
        "--sides",
        default=DEFAULT.sides,
        metavar="|".join(SIDES),
        help=f"how the patient's sides are shown (default {DEFAULT.sides}: letters where they are known)",
    )
    page.add_argument("--no-color-bar", action="store_true", help="leave the color bar out")
    page.add_argument("--names", action="store_true", help="write names of segments beside the pictures")
    panels = parser.add_argument_group("panels", "one picture unless given; both together make a grid")
    panels.add_argument(
        "--compare",
        action="append",
        default=[],
        metavar="NAME|FILE",
        help="a preset or a transfer function file, each in a panel of its own; may be given several times",
    )
    panels.add_argument(
        "--view", action="append", nargs=2, type=float, default=[], metavar=("AZIMUTH", "ELEVATION"),
        help="a view of the turntable, each in a panel of its own; may be given several times")  # fmt: skip
    panels.add_argument(
        "--title", action="append", default=[], metavar="TEXT",
        help="title of a panel, once for each (default: what they differ in)")  # fmt: skip


def _length(text: str) -> float | str:
    """A number, or the word as it is, which FigureStyle checks."""
    try:
        return float(text)
    except ValueError:
        return text


def style_from(args) -> FigureStyle:
    """The style from the options."""
    return FigureStyle(
        width_cm=args.width_cm, dpi=args.dpi, columns=args.columns, background=args.background,
        font_size=args.font_size, aspect=args.aspect, caption=args.caption, scale_bar=args.scale_bar,
        scale_depth=args.scale_depth, sides=args.sides, color_bar=not args.no_color_bar,
    )  # fmt: skip


@dataclass(frozen=True)
class WantedPanels:
    """What the panels of a figure differ in: transfer functions and views, each at least one, as options.

    Attributes
    ----------
    functions : tuple of Namespace
        The options of each transfer function.
    found : tuple
        The result of ``read_transfer_function`` for each.
    views : tuple of Namespace
        The options of each view.
    """

    functions: tuple
    found: tuple
    views: tuple

    @property
    def count(self) -> int:
        """The number of panels."""
        return len(self.functions) * len(self.views)


def list_panels(args, read) -> WantedPanels:
    """What the panels of a figure differ in; ``read``: ``read_transfer_function``.

    Raises
    ------
    RleSplatError
        If options contradict each other, or name what is not there.
    """
    for option, name in (("--transfer-function", args.transfer_function), ("--preset", args.preset)):
        if args.compare and name is not None:
            raise RleSplatError(
                f"--compare and {option} contradict each other; give every transfer function by --compare."
            )
    given = [name for name in ("azimuth", "elevation") if getattr(args, name) is not None]
    if args.view and (given or args.camera is not None):
        other = f"--{given[0]}" if given else "--camera"
        raise RleSplatError(f"--view and {other} contradict each other; give every view by --view.")
    functions = tuple(_with_function(args, name) for name in args.compare) or (args,)
    views = tuple(_with(args, azimuth=azimuth, elevation=elevation) for azimuth, elevation in args.view) or (args,)
    wanted = WantedPanels(functions, tuple(read(one) for one in functions), views)
    if args.title and len(args.title) != wanted.count:
        raise RleSplatError(
            f"--title is given {len(args.title)} times for {wanted.count} panels; give one for each panel, or none."
        )
    return wanted


def _with(args, **values) -> Namespace:
    return Namespace(**{**vars(args), **values})


def _with_function(args, name: str) -> Namespace:
    """The options with one transfer function of --compare: a file if it has a suffix or is there, else a preset."""
    if name not in PRESETS and (Path(name).suffix or Path(name).is_file()):
        return _with(args, transfer_function=name, preset=None)
    preset(name)
    return _with(args, transfer_function=None, preset=name)


def panels_of(args, volume, wanted: WantedPanels, scene_of) -> tuple[list[Panel], list[str]]:
    """The panels of a figure, row by row.

    Parameters
    ----------
    args : argparse.Namespace
    volume : Volume
    scene_of : callable
        ``scene_of(options, transfer_function)`` is the Scene of a view.

    Returns
    -------
    panels : list of Panel
    reasons : list of str
        Why each transfer function is what it is.
    """
    panels, reasons = [], []
    for options, found in zip(wanted.functions, wanted.found, strict=True):
        function, reason = choose_transfer_function(options, volume, found)
        reasons.append(f"Transfer function {function.name}: {reason}")
        for view in wanted.views:
            panels.append(Panel(scene_of(view, function)))
    titles = args.title or [_title(panel, wanted, n) for n, panel in enumerate(panels)]
    names = [names_of(panel.scene) if args.names else () for panel in panels]
    if args.names and not any(names):
        raise RleSplatError("--names has no names; give --labels with a file that names its segments.")
    return [replace(one, title=title, names=of) for one, title, of in zip(panels, titles, names, strict=True)], reasons


def _title(panel: Panel, wanted: WantedPanels, n: int) -> str:
    """What a panel differs in from the others."""
    of_function, of_view = divmod(n, len(wanted.views))
    parts = []
    if len(wanted.functions) > 1:
        parts.append(panel.scene.transfer_function.name or wanted.functions[of_function].transfer_function or "")
    if len(wanted.views) > 1:
        parts.append(view_name(panel.scene) or _angles(wanted.views[of_view]))
    return ", ".join(filter(None, parts))


def _angles(view) -> str:
    angles = {name: TURNTABLE_DEFAULTS[name] if getattr(view, name) is None else getattr(view, name)
              for name in ("azimuth", "elevation")}  # fmt: skip
    return ", ".join(f"{name} {angle:g}°".replace("-", "−") for name, angle in angles.items()).capitalize()
