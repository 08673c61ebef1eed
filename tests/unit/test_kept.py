"""What is kept between frames: content keys, eviction by bytes, and jobs that are all or nothing."""

import pytest

from rle_splat.pipeline.stage_cache import MOST_RESULTS, Kept


def keep(kept, stage, key, result, size=10):
    job = kept.job()
    got = job.get(stage, key, lambda: result, lambda r: size)
    job.keep()
    return got


def test_a_result_is_made_once_per_content():
    kept = Kept()
    first = keep(kept, "stage", ("a", 1), [1])
    again = keep(kept, "stage", ("a", 1), [2])
    other = keep(kept, "stage", ("a", 2), [3])
    assert first is again and other == [3] and kept.made == {"stage": 2} and kept.nbytes == 20


def test_the_least_recently_used_leaves_first():
    kept = Kept(most_bytes=25)
    for name in "abac":
        keep(kept, "s", name, name)
    assert kept.has("s", "a") and kept.has("s", "c") and not kept.has("s", "b") and kept.nbytes == 20


def test_of_what_replaces_one_another_a_few_are_kept():
    kept = Kept()
    keep(kept, "other", 0, "stays")
    for number in range(10):
        keep(kept, "records", number, number)
    most = MOST_RESULTS["records"]
    assert kept.contents == (("other", 0), *(("records", n) for n in range(10 - most, 10)))


def test_a_store_without_room_keeps_nothing():
    kept = Kept(0)
    keep(kept, "s", "a", "a")
    assert kept.contents == () and not kept.keeps


def test_a_job_that_fails_or_is_dropped_leaves_all_as_it_was():
    kept = Kept()
    keep(kept, "s", "old", "old")
    keep(kept, "s", "older", "older")
    before = kept.contents
    job = kept.job()
    assert job.get("s", "old", lambda: "never", lambda r: 1) == "old"
    assert job.get("s", "new", lambda: "new", lambda r: 1) == "new"
    assert job.get("s", "new", lambda: "never", lambda r: 1) == "new"
    with pytest.raises(ZeroDivisionError):
        job.get("s", "x", lambda: 1 / 0, lambda r: 1)
    assert kept.contents == before and kept.nbytes == 20


def test_steps_that_are_closed_half_way_leave_nothing():
    kept = Kept()

    def work():
        yield 0.5
        return "whole"

    job = kept.job()
    steps = job.steps("s", "a", work, lambda r: 1)
    assert next(steps) == 0.5
    steps.close()
    assert kept.contents == () and kept.made == {}
    steps = job.steps("s", "a", work, lambda r: 1)
    assert list(steps) == [0.5]
    job.keep()
    assert kept.has("s", "a") and kept.made == {"s": 1}


def test_what_a_job_has_found_stays_at_hand_whatever_becomes_of_the_store():
    """Another thread's picture may empty a store, or fill it, between any two steps of a job."""
    kept = Kept()
    keep(kept, "s", "one", "first")
    keep(kept, "s", "two", "second")
    job = kept.job()
    assert job.has("s", "one")

    def serves(key, result):
        kept.clear()
        keep(kept, "s", "three", "third")
        return key == "two"

    assert job.latest("s", serves) == "two"
    assert (job.get("s", "one", None), job.get("s", "two", None)) == ("first", "second")
    job.keep()
    assert kept.contents == (("s", "three"), ("s", "one"), ("s", "two")) and kept.nbytes == 30
