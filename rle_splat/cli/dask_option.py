"""The options ``--dask``, ``--workers`` and ``--slabs``: pictures and frames on a Dask cluster."""

import os
from argparse import ArgumentTypeError
from importlib.util import find_spec

from ..scene import RleSplatError

LOCAL = ""  # --dask without an address
MOST = 1024  # workers, slabs


def add_dask_option(parser) -> None:
    """Add the options."""
    group = parser.add_argument_group("cluster", "needs the packages of the extra scale: dask and distributed")
    group.add_argument(
        "--dask", nargs="?", const=LOCAL, type=_address, metavar="ADDRESS",
        help="render on a Dask cluster, such as tcp://host:8786; without an address, on processes of this machine",
    )  # fmt: skip
    group.add_argument(
        "--workers", type=int, metavar="N", help="processes of --dask without an address (default: 2 or more)"
    )
    group.add_argument(
        "--slabs", type=int, metavar="N",
        help="draw a folder of tables in N slabs from front to back, so that a worker reads only some of them; the "
        "picture has no depth",
    )  # fmt: skip


def _address(word: str) -> str:
    """The word behind --dask, which may be the volume in its place."""
    if word != LOCAL and (":" not in word or os.path.exists(word)):
        raise ArgumentTypeError(
            f"{word!r} is no address such as tcp://host:8786; if it is the volume, put it before --dask"
        )
    return word


def check_dask(args) -> None:
    """Check the options before any volume is read.

    Raises
    ------
    RleSplatError
        If a package is missing, or an option has no effect on a cluster.
    """
    if args.dask is None:
        for option in ("workers", "slabs"):
            if getattr(args, option) is not None:
                raise RleSplatError(f"--{option} has no effect without --dask; add --dask, or remove it.")
        return
    if args.workers is not None and (args.dask != LOCAL or not 1 <= args.workers <= MOST):
        given = f"--workers is {args.workers}" if args.dask == LOCAL else f"--dask {args.dask} has its own workers"
        raise RleSplatError(f"{given}; give --workers a number from 1 to {MOST}, with --dask without an address.")
    for option, remedy in (
        ("tolerance", "choose a --quality"), ("shadow_pass", "render the shadow pass on one machine"),
        ("memory_limit", "choose --tile, or limit the memory of the workers"),
    ):  # fmt: skip
        if getattr(args, option) is not None:
            raise RleSplatError(f"--{option.replace('_', '-')} and --dask cannot be combined; {remedy}.")
    for option in ("tile", "slabs"):
        if getattr(args, option) is not None and (args.frames is not None or args.camera_path is not None):
            raise RleSplatError(f"On a cluster each frame is one task; remove --{option}.")
    if args.slabs is not None:
        _check_slabs(args)
    if find_spec(f"{__package__}.cluster") is None or find_spec("distributed") is None:
        raise RleSplatError("--dask needs the packages dask and distributed; install rle-splat[scale].")


def _check_slabs(args) -> None:
    """RleSplatError for a volume that slabs cannot be read of, or a number that is no number of slabs."""
    from ..encode.folder import is_folder_form

    if not 1 <= args.slabs <= MOST:
        raise RleSplatError(f"--slabs is {args.slabs}; give a number from 1 to {MOST}.")
    if os.path.exists(args.volume) and not is_folder_form(args.volume):
        raise RleSplatError(
            f"--slabs draws a folder of tables in parts, and {args.volume} is none; make one with rle-splat encode "
            "--folder, or remove --slabs."
        )
