"""Help in two lengths: ``--help`` has the usual options in a line or two each, ``--help-all`` explains every option."""

import argparse
import copy
import sys

# What --help leaves out.
RARE = {
    "--debug", "--progress", "--tile", "--mist", "--motion", "--byte-order", "--header-bytes", "--slope", "--intercept",
    "--grid", "--level", "--unit", "--value-unit", "--modality", "--transfer-name", "--effect", "--fit", "--fov",
    "--volume-matrix", "--scene-scale", "--camera-path", "--like", "--again", "--dask", "--workers", "--slabs",
    "--environment", "--indirect-light", "--shadow-pass", "--label-edges", "--file-channels", "--channel-function",
    "--probes", "--paper", "--classification", "--depth-rule", "--sheet-density", "--kernel", "--minification",
    "--warp-filter", "--termination", "--axis-fade", "--rays", "--model", "--record", "--data", "--aspect",
    "--font-size", "--scale-depth",
}  # fmt: skip


class HelpAll(argparse.Action):
    """Print the help with every option, and leave."""

    def __call__(self, parser, namespace, values, option_string=None):
        sys.stdout.write(argparse.ArgumentParser.format_help(parser))
        parser.exit()


def usage(parser: argparse.ArgumentParser) -> str:
    """The command line in short: what must be given, and ``[options]``."""
    needed = []
    for action in parser._actions:
        value = str(action.metavar or action.dest.upper())
        if not action.option_strings:
            needed.append(value)
        elif action.required:
            needed.append(f"{action.option_strings[0]} {value}")
    return " ".join((parser.prog, *needed, "[options]"))


def brief_help(parser: argparse.ArgumentParser) -> str:
    """The usual options, each with the first part of its text, up to a semicolon."""
    formatter = parser._get_formatter()
    formatter.add_usage(parser.usage, parser._actions, ())
    formatter.add_text(parser.description)
    for group in parser._action_groups:
        actions = [action for action in group._group_actions if not RARE.intersection(action.option_strings)]
        formatter.start_section(group.title)
        if any(action.help != argparse.SUPPRESS for action in actions):
            formatter.add_text(_first_part(group.description))
        formatter.add_arguments(map(_shorten, actions))
        formatter.end_section()
    formatter.add_text(parser.epilog)
    return formatter.format_help()


def _shorten(action: argparse.Action) -> argparse.Action:
    shorter = copy.copy(action)
    shorter.help = _first_part(action.help)
    return shorter


def _first_part(text: str | None) -> str | None:
    return text and text.partition(";")[0]
