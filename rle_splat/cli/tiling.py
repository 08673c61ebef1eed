"""The option ``--tile``: pictures that are rendered and written in parts."""

from contextlib import ExitStack

from ..scene import RleSplatError
from .rows import row_writer_for

SMALLEST = 16  # pixels


def add_tile_option(parser) -> None:
    """Add the option."""
    parser.add_argument(
        "--tile", type=int, metavar="N",
        help="render and write the picture in tiles of N pixels, which takes less memory and gives the same picture "
        "(default: as large as fits, where --memory-limit is given and the whole picture does not fit)",
    )  # fmt: skip


def check_tiles(args) -> None:
    """Check the options of tiles before any volume is read.

    Raises
    ------
    RleSplatError
        If the tiles are too small, or the picture cannot be made in tiles.
    """
    if args.tile is not None and args.tile < SMALLEST:
        raise RleSplatError(f"--tile is {args.tile}; give a whole number of pixels from {SMALLEST} on.")
    if args.tile is None:
        return
    if args.tolerance is not None:
        raise RleSplatError(
            "--tolerance measures the whole picture, and --tile makes it in parts; choose a --quality with --tile."
        )
    if args.shadow_pass is not None:
        raise RleSplatError("The shadow pass is made of the whole picture at once; remove --tile or --shadow-pass.")


def side_of_tiles(args, scene, quality) -> int | None:
    """The side of the tiles in pixels; None for a picture that is made at once."""
    if args.tile is not None or args.memory_limit is None or args.tolerance is not None or args.shadow_pass is not None:
        return args.tile
    from ..pipeline.tiles import choose_tile_side

    return choose_tile_side(scene, quality)


def render_tiles(args, prepared, side: int, parts, job):
    """Generator of Progress: render in tiles to ``parts``, files for ``args.output``; returns the renderer's report.

    ``prepared``, ``job``: a Prepared and a Job of ``render``.
    """
    from ..pipeline.tiles import render_tiles_steps

    left, top, right, bottom = prepared.scene.region
    with ExitStack() as stack:
        files = [
            stack.enter_context(row_writer_for(path)(part, right - left, bottom - top, args.background))
            for path, part in zip(args.output, parts, strict=False)
        ]

        def write(rgba, depth):
            for file in files:
                file.write(rgba, depth)

        return (yield from render_tiles_steps(
            prepared.scene, prepared.quality, side, write, job.cache, refuse_empty_view=job.refuse_empty_view,
        ))  # fmt: skip
