"""Since when something is seen without a break."""

from bagpipe_operator.runtime.patience import Patience


def test_what_is_seen_again_has_been_there_since_it_was_first_seen() -> None:
    patience = Patience()
    assert patience.observe("x", ["image"], 100.0) == {"image": 0.0}
    assert patience.observe("x", ["image", "secret"], 130.0) == {"image": 30.0, "secret": 0.0}
    assert patience.observe("y", ["image"], 140.0) == {"image": 0.0}
    assert patience.observe("x", ["secret"], 150.0) == {"secret": 20.0}
    assert patience.observe("x", ["image", "secret"], 160.0) == {"image": 0.0, "secret": 30.0}


def test_a_break_or_a_job_that_is_gone_starts_from_zero() -> None:
    patience = Patience()
    patience.forget("x")
    for forget in (lambda: patience.observe("x", [], 105.0), lambda: patience.forget("x")):
        patience.observe("x", ["image"], 100.0)
        assert patience.observe("x", ["image"], 101.0) == {"image": 1.0}
        forget()
        assert patience.observe("x", ["image"], 110.0) == {"image": 0.0}
        patience.forget("x")
    assert patience.observe("x", [], 120.0) == {}
