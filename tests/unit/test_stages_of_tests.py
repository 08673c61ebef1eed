"""The stages of dev.py test: what runs where, and what is said of what cannot run."""

from concurrent.futures import Future

from devtools import testing
from devtools.places import Failure


def test_extras_are_skipped_in_one_line_where_their_environment_cannot_be_made(capsys):
    environment = Future()
    environment.set_exception(Failure("pip could not."))
    stage = testing._extras(environment, [])
    assert (stage.verdict, stage.skipped, stage.remarks) == ("SKIPPED", 1, ["pip could not."])
    assert capsys.readouterr().out.count("\n") == 2  # an empty line before it


def test_each_test_of_the_core_runs_in_one_of_two_stages(monkeypatch):
    """What the core leaves out, the extras take, in the environment that has what they want."""
    runs = {}

    def run(name, python, words, seconds, environ, aside=False):
        runs[name] = (python, words[words.index("-m") + 1])

    monkeypatch.setattr(testing, "_pytest", run)
    monkeypatch.setattr(testing, "ensure", lambda environment: environment.name)
    environment = Future()
    environment.set_result("bench")
    testing._without_hard_cases([*testing._leave_out(testing.EXTRAS), "-x"])
    testing._extras(environment, ["-x"])
    assert runs == {"core": ("core", "not extras"), testing.EXTRAS_STAGE: ("bench", "extras")}
    assert testing._leave_out() == [] and testing._leave_out("slow", "extras") == ["-m", "not slow and not extras"]
