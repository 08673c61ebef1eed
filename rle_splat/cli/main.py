"""``rle-splat COMMAND ...``: runs a command and handles its errors.

Exit codes: 0 success, 1 an internal error, 2 bad input or usage, 130 stopped with Ctrl-C.  An error prints one sentence
on stderr, and a traceback only with ``--debug``.  Heavy imports happen inside ``main``, so that only the commands that
need them pay for them and their errors are handled too.
"""

import errno
import gc
import re
import signal
import sys
from decimal import Decimal
from importlib import import_module
from importlib.util import find_spec

from .streams import settle_streams

DONE, FAILURE, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

# Command -> its description in the help.  Each command is a module of this folder with ``add_arguments(parser)`` and
# ``run(args)``.  A command without its module is left out: the extension has no compare.
COMMANDS = {
    "render": "render a volume to a picture (.png, .exr, .tif, .npy)",
    "info": "describe a volume: shape, type, spacing, range, histogram, unusual data",
    "figure": "make a figure for print, with scale bar, color bar and sidecar (.svg, .png, .exr, .pdf)",
    "encode": "classify, shade and run-length encode a volume into a .rle file",
    "convert": "write a volume in another format",
    "accuracy": "measure error and time of several quality settings on a volume and view: table, JSON",
    "prepare": "compile ahead what a default picture needs, so that the first one is quick",
    "compare": "compare the methods that the paper names: time, memory, error",
}
COMMANDS = {name: purpose for name, purpose in COMMANDS.items() if find_spec(f"{__package__}.{name}")}
EXAMPLES = {
    "render": "scan.nii.gz --preset ct-bone --azimuth 30 -o out.png",
    "info": "scan.nii.gz",
    "figure": "scan.nii.gz --preset ct-bone --view 0 0 --view 90 0 -o fig.svg",
    "encode": "scan.nii.gz --preset ct-bone -o scan.rle",
    "convert": "scan.nii.gz scan.nrrd",
    "accuracy": "scan.nii.gz --azimuth 30 --json a.json",
    "prepare": "--json report.json",
    "compare": "scan.nii.gz --json compare.json",
}

ADVICE = {
    errno.ENOSPC: "make room there, or choose another place",
    errno.EACCES: "check the permissions, or choose another place",
}  # fmt: skip

# Option -> the most numbers that it takes, and the mark that joins them.
SEVERAL_NUMBERS = {"--size": (2, "x"), "--background": (3, ",")}
NEGATIVE_NUMBER = re.compile(r"-(\d+\.?\d*|\.\d+)(e[+-]?\d{1,3})?", re.IGNORECASE)


def example(name: str) -> str:
    """A command line of a command, as an example."""
    return f"rle-splat {name} {EXAMPLES[name]}"


def _sentence(message) -> str:
    """A message on one line, ending with a period unless it has an end mark."""
    text = " ".join(str(message).split())
    return text if text.endswith((".", "!", "?")) else text + "."


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _join_numbers(argv: list[str]) -> list[str]:
    """Replace ``--size W H`` by ``--size=WxH``; an option with one or two values would swallow VOLUME in argparse."""
    joined, option, count = [], "", 0
    for word in argv:
        most, mark = SEVERAL_NUMBERS.get(option, (0, ""))
        if count < most and _is_number(word):
            joined[-1] += f"{mark if count else '='}{word}"
            count += 1
        else:
            joined.append(word)
            option, count = word, 0
    return joined


def _plain_negatives(argv: list[str]) -> list[str]:
    """Write negative numbers without exponents, because argparse takes ``-1e3`` for an option."""
    return [format(Decimal(word), "f") if NEGATIVE_NUMBER.fullmatch(word) else word for word in argv]


def _build_parser(asked: str | None):
    """The parser of all commands, with options only for the command ``asked``.

    Options of the other commands would load their modules (measured: a tenth of a small picture's time).
    """
    import argparse

    from ..runtime.cache_folder import RELEASE
    from ..scene import RleSplatError
    from .help_text import HelpAll, brief_help, usage

    class Parser(argparse.ArgumentParser):
        """An argparse parser that raises RleSplatError for a wrong command line."""

        def error(self, message):
            if message.startswith("the following arguments are required: "):
                message = f"Required arguments are missing: {message.split(': ', 1)[1]}"
            elif message.startswith("argument "):
                message = "Option " + message[len("argument ") :]
            raise RleSplatError(f"{message}; see {self.prog} --help.")

    class CommandParser(Parser):
        """The parser of one command, whose ``--help`` is brief."""

        def format_help(self):
            return brief_help(self)

    parser = Parser(
        prog="rle-splat", allow_abbrev=False, description="Render volumes by splatting run-length encoded voxels."
    )
    parser.add_argument("--version", action="version", version=f"rle-splat {RELEASE}", help="print the version")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=CommandParser)
    for name, purpose in COMMANDS.items():
        command = commands.add_parser(
            name, help=purpose, description=purpose, epilog=f"example: {example(name)}", allow_abbrev=False
        )
        command.add_argument("--help-all", action=HelpAll, nargs=0, default=argparse.SUPPRESS, help="show every option")
        command.add_argument(
            "--debug", action="store_true", default=argparse.SUPPRESS, help="show the traceback of an error"
        )
        if name == asked:
            module = import_module(f".{name}", __package__)
            module.add_arguments(command)
            command.usage = usage(command)
            command.set_defaults(run=module.run, prog=command.prog)
    return parser


def _run(argv: list[str]) -> None:
    from ..scene import RleSplatError

    first = next((word for word in argv if not word.startswith("-")), None)
    if first is not None and first not in COMMANDS:
        raise RleSplatError(f"There is no command {first!r}; choose {', '.join(COMMANDS)}.")
    parser = _build_parser(first)
    args, unknown = parser.parse_known_args(_plain_negatives(_join_numbers(argv)))
    if args.command is None:
        raise RleSplatError(f"No command was given; choose {', '.join(COMMANDS)}, or see rle-splat --help.")
    if unknown:
        raise RleSplatError(_unknown_words(unknown, args))
    from ..runtime.memory import limit_process_to

    limit_process_to(getattr(args, "memory_limit", None))
    try:
        args.run(args)
    finally:
        limit_process_to(None)


def _unknown_words(unknown: list[str], args) -> str:
    option = next((word for word in unknown if word.startswith("-")), None)
    if option is None:
        return f"The argument {unknown[0]!r} is unexpected; remove it, or see {args.prog} --help."
    return f"{args.prog} has no option {option.split('=')[0]}; see {args.prog} --help for its options."


def main(argv=None) -> int:
    """Run one command line; return the exit code.

    Parameters
    ----------
    argv : list of str, optional
        The arguments; default those of the process.
    """
    argv = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in argv
    try:
        from ..scene import Cancelled, RleSplatError
    except KeyboardInterrupt:
        print("Stopped.", file=sys.stderr)
        return INTERRUPTED
    try:
        _run(argv)
        sys.stdout.flush()
        return DONE
    except SystemExit as end:  # --help and --version leave this way
        return DONE if end.code is None else end.code
    except (Exception, KeyboardInterrupt) as problem:
        if debug:
            import traceback

            traceback.print_exception(problem)
        message, code = _verdict(problem, RleSplatError, Cancelled)
        print(_sentence(message), file=sys.stderr)
        return code


class _CtrlC(KeyboardInterrupt):
    """Raised for Ctrl+C.

    Where KeyboardInterrupt itself leaves an ``exec`` of text, as of dataclasses in an import, ``python -m`` ends the
    process by the signal, whatever its exit code, though the exception was handled.
    """


def _stop(*_):
    raise _CtrlC


def run_process() -> int:
    """``main`` for a process that ends afterward.

    Freezing the garbage collector skips its final collection before the system frees the memory anyway (measured: it
    takes 0.15 to 0.2 s).
    """
    # Modules and kernels stay in memory, so looking through them often is of no use (measured: 0.08 s of 1.0).
    gc.set_threshold(50_000, 20, 20)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _stop)
    settle_streams()
    code = main()
    gc.freeze()
    return code


def _verdict(problem, bad_input, cancelled) -> tuple[str, int]:
    """The sentence and the exit code of an exception; ``bad_input`` and ``cancelled`` are our exception classes."""
    if isinstance(problem, bad_input):
        return str(problem), BAD_INPUT
    if isinstance(problem, (KeyboardInterrupt, cancelled)):
        return str(problem) or "Stopped; nothing was written.", INTERRUPTED
    detail = f" ({problem})" if str(problem) else ""
    if isinstance(problem, MemoryError):
        return f"There is not enough memory{detail}; use a smaller volume, image or sheet density.", FAILURE
    if isinstance(problem, OSError):
        place = f" ({problem.filename})" if problem.filename else ""
        said = f"{problem.strerror or str(problem).rstrip('.')}{place}"
        return "; ".join(filter(None, (f"The system reported an error: {said}", ADVICE.get(problem.errno)))), FAILURE
    return f"An internal error occurred ({type(problem).__name__}{detail}); add --debug to see where.", FAILURE
