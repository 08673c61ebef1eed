"""``rle-splat prepare``: compile what a default picture needs, so that the first one does not wait for it."""

from __future__ import annotations

from dataclasses import asdict
from time import perf_counter

from ..runtime.outputs import check_outputs, write_report
from ..runtime.whole_files import whole_files
from .options import add_report_options
from .progress import ProgressLine


def add_arguments(parser) -> None:
    add_report_options(parser)


def run(args) -> None:
    start = perf_counter()
    outputs = [args.json] if args.json else []
    check_outputs(outputs)
    with ProgressLine(args.progress) as line:
        line.show(0.0, "loading the renderer")
        from ..pipeline.prepare import prepare_steps

        prepared = line.follow(prepare_steps())
    from ..runtime.jit import KERNELS

    seconds = perf_counter() - start
    new = sum(len(one.kernels) for one in prepared)
    with whole_files(outputs) as parts:
        if args.json:
            pictures = [asdict(one) for one in prepared]
            report = {"command": "prepare", "folder": KERNELS, "seconds": seconds, "new": new, "pictures": pictures}
            write_report(parts[0], report)
    if not new:
        print(f"Nothing to do: the compiled code of default pictures is in {KERNELS} already.")
        return
    for one in prepared:
        if one.kernels:
            print(f"{one.seconds:6.1f} s  {one.picture}: {', '.join(one.kernels)}")
    print(f"Compiled {new} functions in {seconds:.1f} s, stored in {KERNELS}.")
