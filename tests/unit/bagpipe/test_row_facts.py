"""What is read off a row and a manifest, of this release's shapes and of earlier ones."""

import pytest

from bagpipe.driver.progress import Progress
from bagpipe.row_facts import Key, counts_of, discarded_runs, key_of
from tests.unit.bagpipe.jobs import make_row


def test_discarded_runs_are_read_in_both_shapes() -> None:
    entry = {
        "reason": "MachineBusy",
        "message": "the player was late",
        "seconds": 5.5,
        "ledger": {},
    }
    row = make_row("a", discarded=["DeliveryIncomplete", entry])
    assert discarded_runs(row) == [
        {"reason": "DeliveryIncomplete", "message": "", "seconds": None},
        entry,
    ]
    assert discarded_runs({"case": "a bag that yields none"}) == []


@pytest.mark.parametrize(
    ("reason", "crashed", "lost"),
    [
        ("StackCrashed", 1, 0),
        ("StackExited", 1, 0),
        ("NodeGone", 1, 0),
        ("NodeRespawned", 1, 0),
        ("MessagesLost", 0, 1),
        ("CriterionFailed", 0, 0),
    ],
)
def test_crashes_and_losses_are_counted_among_the_failed(
    reason: str, crashed: int, lost: int
) -> None:
    progress = Progress("pvc://results/r")
    progress.begin(2)
    progress.add(make_row("a", "failed", reason, attempts=3, starts=2))
    progress.add(make_row("b"))
    cases = progress.snapshot()["cases"]
    assert (cases["failed"], cases["passed"]) == (1, 1)
    assert (cases["crashed"], cases["lost"], cases["discarded"]) == (crashed, lost, 3)


def test_a_manifest_of_an_earlier_release_has_the_words_of_this_one() -> None:
    earlier = {"planned": 2, "passed": 2, "failed": 0, "invalid": 0, "errored": 0, "retried": 4}
    found = counts_of({"counts": earlier})
    assert (found["discarded"], found["crashed"], found["lost"]) == (4, 0, 0)
    assert "retried" not in found
    assert counts_of({"counts": found}) == found


def test_a_whole_number_is_the_same_value_as_an_integer_and_as_a_float() -> None:
    def key(value: object) -> Key:
        return key_of({"case": "a-0", "values": {"speed": value, "more": [{"x": value}]}})

    assert key(1) == key(1.0) != key(1.5)
    assert key(True) != key(1)
    assert key("1") != key(1)
    assert key(float("inf")) != key(float("nan"))
