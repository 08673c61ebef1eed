"""``rle-splat COMMAND ...``: picks the command and keeps the error policy.

Exit codes: 0 done, 2 bad input or usage, 1 a failure of ours, 130 stopped with Ctrl-C.  Whatever goes wrong, the
user reads one sentence on stderr; a traceback only with ``--debug``.  Heavy imports wait until a command needs
them, and happen inside ``main`` so that the policy covers them too.
"""

from __future__ import annotations

import gc
import os
import re
import sys
from decimal import Decimal
from importlib import import_module
from importlib.util import find_spec

DONE, FAILURE, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

# One table of commands: name -> what it does, as the help shows it.  Each is a module of this folder with
# ``add_arguments(parser)`` and ``run(args)``.  A command without its module is left out: the extension has no compare.
COMMANDS = {
    "render": "splat a volume into a picture (.png, .exr, .npy)",
    "info": "say what a volume is: shape, type, spacing, range, histogram, what is odd about it",
    "encode": "classify, shade and run-length encode a volume into a .rle file",
    "convert": "copy a volume from one format to another",
    "accuracy": "measure error against time over the sensible plans on a volume and view: table, JSON, plot",
    "compare": "compare this renderer with the other methods that the paper names: time, memory, error",
}
COMMANDS = {name: purpose for name, purpose in COMMANDS.items() if find_spec(f"{__package__}.{name}")}

NEGATIVE_NUMBER = re.compile(r"-(\d+\.?\d*|\.\d+)(e[+-]?\d{1,3})?", re.IGNORECASE)


def _sentence(message) -> str:
    """``message`` on one line, ending as a sentence does."""
    text = " ".join(str(message).split())
    return text if text.endswith((".", "!", "?")) else text + "."


def _join_size(argv: list[str]) -> list[str]:
    """``--size W H`` as ``--size WxH``.

    argparse would hand every following word to an option that takes one or two, the VOLUME included.
    """
    joined = []
    for word in argv:
        if len(joined) >= 2 and joined[-2] == "--size" and joined[-1].isdigit() and word.isdigit():
            joined[-1] += f"x{word}"
        else:
            joined.append(word)
    return joined


def _plain_negatives(argv: list[str]) -> list[str]:
    """Negative numbers without exponents, since argparse would take ``-1e3`` for an option; all else as it is."""
    return [format(Decimal(word), "f") if NEGATIVE_NUMBER.fullmatch(word) else word for word in argv]


def _build_parser(asked: str | None):
    """The parser of all commands' names, and of the options of the one that is asked for: those of the others would
    have their modules loaded (measured: a tenth of a small picture's time)."""
    import argparse

    from ..scene import RleSplatError

    class Parser(argparse.ArgumentParser):
        """argparse that reports a wrong command line as every other wrong input is reported."""

        def error(self, message):
            if message.startswith("the following arguments are required: "):
                message = f"Something is missing: {message.split(': ', 1)[1]}"
            elif message.startswith("argument "):
                message = "Option " + message[len("argument ") :]
            raise RleSplatError(f"{message}; see {self.prog} --help.")

    parser = Parser(
        prog="rle-splat", allow_abbrev=False, description="Splat run-length encoded volumes into pictures."
    )
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)
    for name, purpose in COMMANDS.items():
        command = commands.add_parser(name, help=purpose, description=purpose, allow_abbrev=False)
        command.add_argument(
            "--debug", action="store_true", default=argparse.SUPPRESS, help="show the traceback of an error"
        )
        if name == asked:
            module = import_module(f".{name}", __package__)
            module.add_arguments(command)
            command.set_defaults(run=module.run, prog=command.prog)
    return parser


def _run(argv: list[str]) -> None:
    from ..scene import RleSplatError

    first = next((word for word in argv if not word.startswith("-")), None)
    if first is not None and first not in COMMANDS:
        raise RleSplatError(f"There is no command {first!r}; choose {', '.join(COMMANDS)}.")
    parser = _build_parser(first)
    args, unknown = parser.parse_known_args(_plain_negatives(_join_size(argv)))
    if args.command is None:
        raise RleSplatError(f"Say what to do: {', '.join(COMMANDS)}; see rle-splat --help.")
    if unknown:
        raise RleSplatError(_unknown_words(unknown, args))
    args.run(args)


def _unknown_words(unknown: list[str], args) -> str:
    option = next((word for word in unknown if word.startswith("-")), None)
    if option is None:
        return f"{unknown[0]!r} is one word too many; see {args.prog} --help."
    return f"{args.prog} has no option {option.split('=')[0]}; see {args.prog} --help for those it has."


def main(argv=None) -> int:
    """Run one command line (default: the process's own) and return the exit code."""
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
    except SystemExit as end:  # --help leaves this way
        return DONE if end.code is None else end.code
    except BrokenPipeError:
        # The reader of our output has gone (``| head``): say nothing, and keep the interpreter's last flush quiet.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except (Exception, KeyboardInterrupt) as problem:
        if debug:
            import traceback

            traceback.print_exception(problem)
        message, code = _verdict(problem, RleSplatError, Cancelled)
        print(_sentence(message), file=sys.stderr)
        return code


def run_process() -> int:
    """``main`` for a process of its own, which leaves at once.

    Python would look through all that is in memory for what refers to itself, to take it apart piece by piece, before
    the system takes the memory back as a whole (measured: 0.15 to 0.2 s, which a user waits for).
    """
    # Modules and kernels stay in memory, so looking through them often is of no use (measured: 0.08 s of 1.0).
    gc.set_threshold(50_000, 20, 20)
    code = main()
    gc.freeze()
    return code


def _verdict(problem, bad_input, cancelled) -> tuple[str, int]:
    """The sentence and the exit code for an exception; the two last are our own classes."""
    if isinstance(problem, bad_input):
        return str(problem), BAD_INPUT
    if isinstance(problem, (KeyboardInterrupt, cancelled)):
        return "Stopped; nothing was written.", INTERRUPTED
    detail = f" ({problem})" if str(problem) else ""
    if isinstance(problem, MemoryError):
        return f"There is not enough memory for this{detail}; use a smaller volume, image or sheet density.", FAILURE
    if isinstance(problem, OSError):
        place = f" ({problem.filename})" if problem.filename else ""
        return f"The system refused: {problem.strerror or problem}{place}.", FAILURE
    return f"This failed for a reason of our own ({type(problem).__name__}{detail}); --debug shows where.", FAILURE
