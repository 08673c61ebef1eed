"""How long hypothesis searches: the same examples at every run of the suite, new ones with ``dev.py test --fuzz``."""

from __future__ import annotations

from hypothesis import HealthCheck, settings

from devtools.fuzzing import asked_for

# Times as many examples when a longer search is asked for; its seed is told by --hypothesis-seed.
LONGER = 5


def examples(count: int):
    """A decorator: ``count`` examples of a test, derived from the test itself and so always the same; or many more."""
    longer = asked_for()
    return settings(
        max_examples=count * (LONGER if longer else 1), derandomize=not longer, deadline=None, database=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
