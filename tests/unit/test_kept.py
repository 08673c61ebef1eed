"""What is kept between frames: content keys, and eviction by bytes."""

from rle_splat.kept import Kept


def test_a_result_is_made_once_per_content():
    kept = Kept()
    first = kept.get("stage", ("a", 1), lambda: [1], lambda r: 10)
    again = kept.get("stage", ("a", 1), lambda: [2], lambda r: 10)
    other = kept.get("stage", ("a", 2), lambda: [3], lambda r: 10)
    assert first is again and other == [3] and kept.made == {"stage": 2}


def test_the_least_recently_used_leaves_first():
    kept = Kept(most_bytes=25)
    kept.get("s", "a", lambda: "a", lambda r: 10)
    kept.get("s", "b", lambda: "b", lambda r: 10)
    kept.get("s", "a", lambda: "again", lambda r: 10)
    kept.get("s", "c", lambda: "c", lambda r: 10)
    assert kept.has("s", "a") and kept.has("s", "c") and not kept.has("s", "b")


def test_a_failed_stage_leaves_nothing():
    kept = Kept()
    try:
        kept.get("s", "x", lambda: 1 / 0, lambda r: 1)
    except ZeroDivisionError:
        assert not kept.has("s", "x")
    else:
        raise AssertionError("the failure must come through")
