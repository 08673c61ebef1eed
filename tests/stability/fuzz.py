"""How long hypothesis searches: the same examples at every run of the suite, new ones with ``dev.py test --fuzz``."""

from __future__ import annotations

from hypothesis import HealthCheck, Phase, settings

from devtools.fuzzing import asked_for

# Times as many examples when a longer search is asked for; its seed is told by --hypothesis-seed.
LONGER = 15


def examples(count: int, shrink: bool = True):
    """A decorator: ``count`` examples of a test, derived from the test itself and so always the same; or many more.

    ``shrink``: whether a failure is made as simple as can be before it is shown; pictures take too long for that.
    """
    longer = asked_for()
    return settings(
        max_examples=count * (LONGER if longer else 1), derandomize=not longer, deadline=None, database=None,
        phases=[phase for phase in Phase if shrink or phase not in (Phase.shrink, Phase.explain)],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
