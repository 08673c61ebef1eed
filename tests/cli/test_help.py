"""``--help`` is brief, and ``--help-all`` explains every option."""

import pytest

from rle_splat.cli.help_text import RARE
from rle_splat.cli.main import COMMANDS

from .every_option import options_of

LONGEST = 120  # lines of --help in a terminal of 80 columns


@pytest.fixture(autouse=True)
def narrow_terminal(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_is_brief_and_help_all_has_every_option(call, command):
    brief, whole = call(command, "--help").out, call(command, "--help-all").out
    assert brief.count("\n") <= LONGEST and "--help-all" in brief
    for text in (brief, whole):
        assert text.startswith(f"usage: rle-splat {command} ") and f"example: rle-splat {command}" in text
    for option in options_of(command):
        assert f"{option} " in whole or f"{option}," in whole or f"{option}\n" in whole, option
        assert (f"  {option} " in brief) <= (option not in RARE), option


def test_help_names_what_a_picture_usually_needs(call):
    brief = call("render", "--help").out
    assert all(f"{option} " in brief for option in ("--preset", "--azimuth", "--size", "--quality", "--labels"))


def test_every_rare_option_is_one_of_a_command():
    assert RARE <= {option for command in COMMANDS for option in options_of(command)}
