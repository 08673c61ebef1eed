"""Help is that of the benchmark that was asked about, not that of dev.py."""

import pytest

from benchmarks.__main__ import BENCHMARKS, main
from devtools.bootstrap import nox_words


@pytest.mark.parametrize("name", BENCHMARKS)
def test_each_benchmark_tells_its_own_options(name, capsys):
    with pytest.raises(SystemExit) as stopped:
        main([name, "--help"])
    told = capsys.readouterr().out
    assert stopped.value.code == 0 and name in told.split("[-h]")[0] and told.count("--") > 1


def test_help_without_a_name_lists_them_all(capsys):
    assert main(["--help"]) == 0
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines()[2:]]
    assert listed == list(BENCHMARKS)


def test_a_name_that_there_is_not_is_refused(capsys):
    assert main(["speed"]) == 2 and "stages" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", (["bench", "editing", "--help"], ["bench", "-h"], ["accuracy", "--help"]))
def test_dev_hands_the_question_on(arguments):
    words = nox_words(arguments)
    assert words[-len(arguments) - 2 :] == ["-s", arguments[0], "--", *arguments[1:]]
