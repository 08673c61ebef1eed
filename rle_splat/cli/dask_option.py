"""The options ``--dask`` and ``--workers``: pictures and frames on a Dask cluster."""

from __future__ import annotations

from importlib.util import find_spec

from ..scene import RleSplatError

LOCAL = ""  # --dask without an address


def add_dask_option(parser) -> None:
    """Add the options."""
    group = parser.add_argument_group("cluster", "needs the packages of the extra scale: dask and distributed")
    group.add_argument(
        "--dask", nargs="?", const=LOCAL, metavar="ADDRESS",
        help="render on a Dask cluster, such as tcp://host:8786; without an address, on processes of this machine",
    )
    group.add_argument(
        "--workers", type=int, metavar="N", help="processes of --dask without an address (default: 2 or more)")


def check_dask(args) -> None:
    """Check the options before any volume is read.

    Raises
    ------
    RleSplatError
        If a package is missing, or an option has no effect on a cluster.
    """
    if args.dask is None:
        if args.workers is not None:
            raise RleSplatError("--workers has no effect without --dask; add --dask, or remove it.")
        return
    if args.workers is not None and (args.dask != LOCAL or not 1 <= args.workers <= 1024):
        given = f"--workers is {args.workers}" if args.dask == LOCAL else f"--dask {args.dask} has its own workers"
        raise RleSplatError(f"{given}; give --workers a number from 1 to 1024, with --dask without an address.")
    for option, remedy in (
        ("tolerance", "choose a --quality"), ("shadow_pass", "render the shadow pass on one machine"),
        ("memory_limit", "choose --tile, or limit the memory of the workers"),
    ):  # fmt: skip
        if getattr(args, option) is not None:
            raise RleSplatError(f"--{option.replace('_', '-')} and --dask cannot be combined; {remedy}.")
    if args.tile is not None and (args.frames is not None or args.camera_path is not None):
        raise RleSplatError("On a cluster each frame is one task; remove --tile.")
    if find_spec(f"{__package__}.cluster") is None or find_spec("distributed") is None:
        raise RleSplatError("--dask needs the packages dask and distributed; install rle-splat[scale].")
