"""What a status says of notifications, entry by entry and word by word."""

from datetime import UTC, datetime
from typing import Any

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.policies.notifying import (
    kind_of,
    kinds_of,
    pending,
    regressed,
    with_notifications,
)
from bagpipe_operator.notify.letter import Outcome
from bagpipe_operator.receivers import MOST_NAMED, Receiver, Receivers
from tests.unit.operator.builders import make_job

NOW = datetime(2026, 11, 20, 4, 0, tzinfo=UTC)
THEN = "2026-11-20T03:00:00Z"
COMPLETE = {"type": "Complete", "status": "True", "reason": "AllCasesPassed"}
PASSED: Json = {"phase": "Complete", "verdict": "Passed", "conditions": [COMPLETE]}


def receivers(*names: str, **more: Any) -> Receivers:
    return Receivers(Receiver(name, "http://127.0.0.1/", **more) for name in names)


def written_for(
    status: Json,
    known: Receivers | None = None,
    notify: Any = ("team",),
    before: Json | None = None,
    outcomes: dict[str, Outcome] | None = None,
) -> tuple[Any, str, str, str]:
    """The entries, and the condition's status, reason and message."""
    job = make_job("x").with_spec("notify", list(notify)).with_status(**(before or {})).view()
    found = with_notifications(job, status, known or receivers("team"), outcomes or {}, NOW)
    words = [c for c in found.get("conditions") or [] if c["type"] == "Notified"]
    assert len(words) <= 1
    shown = [words[0][key] for key in ("status", "reason", "message")] if words else ["", "", ""]
    return found.get("notifications"), shown[0], shown[1], shown[2]


def after(
    *entries: tuple[str, str], known: Receivers | None = None, **outcomes: Outcome
) -> tuple[Any, str, str, str]:
    """Of a job that has ended with these entries, which are a receiver's name and a state."""
    written = [{"receiver": name, "state": state} for name, state in entries]
    status = PASSED | {"notifications": written}
    return written_for(status, known, before=status, outcomes=outcomes)


def test_before_the_end_the_receivers_are_named_and_nothing_is_owed() -> None:
    running: Json = {"phase": "Running", "conditions": [{"type": "Running", "status": "True"}]}
    expected = (None, "Unknown", "NotEnded", "team, maps: notified when the job has ended.")
    known = receivers("team", "maps")
    assert written_for(running, known, ["team", "maps", "team"]) == expected
    assert written_for({}, known, ["team", "maps"]) == expected
    # What somebody wrote there is taken away, also where nobody is notified.
    forged = running | {"notifications": [{"receiver": "maps", "state": "Pending"}]}
    assert written_for(forged, known, ["team", "maps"]) == expected
    assert written_for(forged, known, []) == (None, "", "", "")
    # An end that is not true is none.
    ending: Json = {"conditions": [COMPLETE | {"status": "False"}]}
    assert written_for(ending, known, ["team", "maps"]) == expected


def test_before_the_end_a_name_without_a_receiver_is_what_it_names() -> None:
    assert written_for({}, notify=["teem", "team"]) == (
        None, "False", "ReceiverUnknown",
        ("spec.notify has teem, which is no receiver for jobs of this namespace: correct it, or let"
         " an administrator add it to the chart's notifications.receivers. The job runs on"
         " without."),
    )  # fmt: skip


@pytest.mark.parametrize("end", ["Complete", "Failed"])
def test_at_the_end_each_receiver_that_asks_for_it_is_owed_one(end: str) -> None:
    status = PASSED | {"conditions": [COMPLETE | {"type": end}]}
    owed = [{"receiver": name, "state": "Pending"} for name in ("team", "maps")]
    assert written_for(status, receivers("team", "maps"), ["team", "maps", "team"]) == (
        owed, "Unknown", "Notifying", "team, maps: being notified.",
    )  # fmt: skip
    for_all = receivers("maps", always=frozenset({"lanes"}))
    assert written_for(status, for_all, [])[0] == owed[1:]
    assert written_for(status, receivers("maps", always=frozenset({"others"})), [])[0] is None


def test_at_the_end_who_asks_for_other_ends_is_owed_nothing() -> None:
    red = receivers("red", events=frozenset({"failed"}))
    nobody: Any = ([], "True", "Notified", "No receiver asks for jobs that end so.")
    assert written_for(PASSED, red, ["red"]) == nobody
    assert written_for(PASSED | {"verdict": "Failed"}, red, ["red"])[0] == [
        {"receiver": "red", "state": "Pending"}
    ]
    assert written_for(PASSED, receivers(), []) == (None, "", "", "")


def test_at_the_end_unknown_names_are_kept_and_come_first() -> None:
    entries, status, reason, message = written_for(PASSED, notify=["teem", "team", "maps"])
    assert entries == [
        {"receiver": "team", "state": "Pending"},
        {"receiver": "teem", "state": "Unknown"},
        {"receiver": "maps", "state": "Unknown"},
    ]
    assert (status, reason) == ("False", "ReceiverUnknown")
    assert message == (
        "spec.notify has teem, maps, which are no receivers for jobs of this namespace: correct it,"
        " or let an administrator add it to the chart's notifications.receivers. team: being"
        " notified."
    )
    assert written_for(PASSED, notify=["teem"])[0] == [{"receiver": "teem", "state": "Unknown"}]


def test_so_many_names_are_read() -> None:
    many = [f"r{number}" for number in range(MOST_NAMED + 1)]
    entries = written_for(PASSED, receivers(*many), many)[0]
    assert [entry["receiver"] for entry in entries] == many[:8]


def test_what_became_of_a_letter_is_written_once_with_its_time() -> None:
    at = "2026-11-20T04:00:00Z"
    assert after(("team", "Pending"), team=Outcome("Delivered")) == (
        [{"receiver": "team", "state": "Delivered", "time": at}],
        "True", "Notified", "team: notified.",
    )  # fmt: skip
    assert after(("team", "Pending"), team=Outcome("Failed", "It answered 410.")) == (
        [{"receiver": "team", "state": "Failed", "time": at, "message": "It answered 410."}],
        "False", "NotificationLost", "team was not notified. It answered 410.",
    )  # fmt: skip
    # Nothing is known of it yet; and what is settled stays.
    assert after(("team", "Pending"))[:3] == (
        [{"receiver": "team", "state": "Pending"}], "Unknown", "Notifying",
    )  # fmt: skip
    for state in ("Delivered", "Failed", "Dropped", "Unknown"):
        entries = after(("team", state), team=Outcome("Failed", "late"), known=receivers("maps"))[0]
        assert entries == [{"receiver": "team", "state": state}]


def test_a_letter_whose_receiver_is_gone_is_dropped_unless_it_went_out() -> None:
    gone = after(("team", "Pending"), known=receivers("maps"))
    assert gone == (
        [{"receiver": "team", "state": "Dropped", "time": "2026-11-20T04:00:00Z",
          "message": "It is not among the operator's receivers any more."}],
        "False", "NotificationLost",
        "team was not notified. It is not among the operator's receivers any more.",
    )  # fmt: skip
    sent = after(("team", "Pending"), known=receivers("maps"), team=Outcome("Delivered"))
    assert sent[0][0]["state"] == "Delivered"


def test_the_gravest_entry_is_the_reason_and_each_has_its_words() -> None:
    lost, known = "NotificationLost", receivers("a", "b", "c", "d", "e", "team")
    entries = [("a", "Delivered"), ("b", "Pending"), ("c", "Dropped"), ("d", "Failed")]
    assert after(*entries, known=known)[1:] == (
        "False", lost,
        "d was not notified.  c was not notified.  b: being notified. a: notified.",
    )  # fmt: skip
    assert after(*entries, ("e", "Unknown"), known=known)[1:3] == ("False", "ReceiverUnknown")
    assert after(*entries[:2], known=known)[1:3] == ("Unknown", "Notifying")
    assert after(entries[0], ("e", "Delivered"), known=known)[3] == "a, e: notified."


def test_a_job_that_ended_before_there_were_notifications_gets_none() -> None:
    assert written_for(PASSED, before=PASSED) == (None, "", "", "")


def test_other_conditions_stay_and_its_own_keeps_the_time_of_its_last_change() -> None:
    old = {"type": "Notified", "status": "Unknown", "reason": "NotEnded", "message": "",
           "lastTransitionTime": THEN}  # fmt: skip
    stale = old | {"status": "True"}
    job = make_job("x").with_spec("notify", ["team"]).with_status(conditions=[old]).view()
    found = with_notifications(
        job, PASSED | {"conditions": [COMPLETE, stale]}, receivers("team"), {}, NOW
    )
    assert found["conditions"][0] == COMPLETE
    [notified] = found["conditions"][1:]
    assert (notified["type"], notified["reason"]) == ("Notified", "Notifying")
    assert (notified["lastTransitionTime"], notified["observedGeneration"]) == (THEN, 1)


def test_who_is_still_to_be_notified() -> None:
    entries = [{"receiver": n, "state": s} for n, s in (("a", "Pending"), ("b", "Delivered"))]
    assert pending({"notifications": entries}) == ["a"]
    assert pending({"notifications": None}) == pending({}) == []


@pytest.mark.parametrize(
    ("comparisons", "count"),
    [(None, 0), ([], 0), ([{"regressed": 2}, {"regressed": 1}, {}], 3), ([{"regressed": "x"}], 0)],
)
def test_regressions_are_counted_over_all_variants(comparisons: Any, count: int) -> None:
    status: Json = {"phase": "Complete", "verdict": "failed", "comparisons": comparisons}
    assert regressed(status) == count
    assert kinds_of(status) == ({"failed", "regressed"} if count else {"failed"})
    assert kind_of(status) == "failed"


def test_a_verdict_of_no_known_word_is_invalid() -> None:
    for verdict in ("Better", "", None, "errored"):
        assert kind_of({"phase": "Complete", "verdict": verdict}) == "invalid"
    assert kind_of({"phase": "Complete", "verdict": "PASSED"}) == "passed"
    assert kind_of({"phase": "Failed"}) == kind_of({"phase": None}) == "errored"
