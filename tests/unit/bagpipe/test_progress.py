"""What a job says of its end fits where it is read, and keeps what to do about it."""

import json
from collections.abc import Callable
from datetime import date
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe.driver.comparing import Compared
from bagpipe.driver.progress import Progress, shortened
from bagpipe.quarantine import Quarantine, QuarantineRule
from bagpipe.row_facts import TALLIES
from bagpipe_operator.api.conditions import LONGEST_MESSAGE
from bagpipe_operator.jobs.driver.progress import parse
from tests.unit.bagpipe.jobs import make_row

ADVICE = "run the case again on a quieter machine, or in lock-step"
LONG = f"the machine could have caused a loss: {'steal up to 55 %; ' * 30}{ADVICE}"


def errored(message: str, cases: int = 1) -> Progress:
    progress = Progress("pvc://results/r")
    progress.begin(cases)
    for number in range(cases):
        row = make_row(f"case-{number}", "errored", "MachineBusy", message=message, result=None)
        progress.add(row)
    progress.finish()
    return progress


def test_the_advice_at_a_long_message_s_end_reaches_the_condition() -> None:
    snapshot = errored(LONG).snapshot()
    assert len(LONG) > 600
    assert snapshot["message"].endswith(ADVICE)
    assert snapshot["message"] == f"1 of 1 cases errored; case-0: MachineBusy: {LONG}"
    assert len(snapshot["message"]) <= LONGEST_MESSAGE
    (failure,) = snapshot["failures"]
    assert len(failure["message"]) == 300
    assert failure["message"].endswith(ADVICE)
    assert failure["message"].startswith("the machine could have caused a loss")


def test_the_operator_reads_all_of_the_longest() -> None:
    progress = errored("x" * 10_000 + ADVICE, cases=9)
    text = progress.termination_message()
    account = parse(text)
    assert len(text.encode()) <= 4096
    assert account is not None
    assert account.message.endswith(ADVICE)
    assert account.message == json.loads(text)["message"]


def ended_with(outcomes: list[str], planned: int = 0) -> dict[str, Any]:
    progress = Progress("pvc://results/r")
    progress.begin(planned or len(outcomes))
    for number, outcome in enumerate(outcomes):
        progress.add(make_row(f"case-{number}", outcome, f"{outcome.capitalize()}Why"))
    progress.finish()
    return progress.snapshot()


def test_what_failed_is_no_reason_for_a_job_without_a_verdict() -> None:
    found = ended_with(["failed"] * 7 + ["errored"])
    assert (found["verdict"], found["reason"]) == ("", "ErroredWhy")
    assert found["message"] == "1 of 8 cases errored; case-7: ErroredWhy: why case-7"
    missing = ended_with(["passed", "failed"], planned=3)
    assert (missing["verdict"], missing["reason"]) == ("", "CasesMissing")
    assert missing["message"] == "1 of 3 cases gave no result"


def test_errors_of_several_reasons_are_one_reason_together() -> None:
    progress = Progress("pvc://results/r")
    progress.begin(3)
    for number in range(3):
        progress.add(make_row(f"case-{number}", "errored", f"Why{number}"))
    progress.finish()
    assert progress.snapshot()["reason"] == "CasesErrored"


def test_what_could_not_be_committed_has_no_verdict() -> None:
    progress = Progress("pvc://results/r")
    progress.begin(1)
    progress.add(make_row("case-0", "passed"))
    assert progress.finish()
    assert progress.snapshot()["verdict"] == "Passed"
    progress.fail("StorageFailed", "no room")
    found = progress.snapshot()
    assert (found["phase"], found["reason"]) == ("Failed", "StorageFailed")
    assert (found["verdict"], found["verdictReason"]) == ("", "")


def test_how_many_cases_ended_on_a_further_start_is_in_the_job_s_sentence() -> None:
    """A hang that the copy of its case does not share passes."""
    progress = Progress("r")
    progress.begin(10)
    for number in range(10):
        progress.add(make_row(f"a-{number}", starts=2 if number % 3 == 0 else 1))
    assert progress.finish()
    assert progress.snapshot()["message"] == (
        "10 of 10 cases ran, verdict Passed; 4 ended on a further start (`starts`)"
    )


NOTHING = dict.fromkeys((*TALLIES, "regressed"), 0)
NO_LEDGER = {"sent": 0, "received": 0, "dropped": 0, "leadIn": 0}


def test_a_job_that_has_just_begun_has_counted_nothing() -> None:
    progress = Progress("pvc://results/r", uid="uid-1", attempt=2)
    assert progress.snapshot() == {
        "uid": "uid-1", "attempt": 2, "phase": "Planning", "ended": False, "reason": "Planning",
        "message": "reading the bags' indexes", "warning": "",
        "cases": {"planned": 0, "running": 0, **NOTHING}, "ledger": NO_LEDGER,
        "verdict": "", "verdictReason": "", "results": "pvc://results/r",
        "failures": [], "comparisons": [],
    }  # fmt: skip
    assert (progress.selection, progress.quarantine, progress.comparisons) == (None, None, [])
    assert Progress("r").snapshot()["attempt"] == 0
    progress.begin(3)
    found = progress.snapshot()
    assert (found["phase"], found["reason"]) == ("Running", "CasesRunning")
    assert (found["message"], found["cases"]["planned"]) == ("3 cases planned", 3)
    progress.close()
    assert progress.snapshot()["ended"]


def test_at_most_as_many_run_as_there_are_slots_and_as_have_not_ended() -> None:
    progress = Progress("r", slots=3)
    progress.begin(5)

    def running(tasks: int) -> tuple[int, int]:
        progress.set_running(tasks)
        return progress.running, progress.left()

    assert [running(tasks) for tasks in (-1, 2, 3, 4)] == [(0, 5), (2, 5), (3, 5), (3, 5)]
    for name in "abc":
        progress.add(make_row(name))
    assert [running(tasks) for tasks in (1, 3)] == [(1, 2), (2, 2)]
    # More rows than cases: those of a bag that was counted as none.
    for name in "defg":
        progress.add(make_row(name))
    assert running(3) == (0, 0)
    one = Progress("r")
    one.begin(2)
    one.set_running(2)
    assert one.running == 1


def test_what_was_sent_and_came_is_the_sum_over_all_cases_that_have_a_ledger() -> None:
    progress = Progress("r")
    progress.begin(4)
    for number in range(2):
        ledger = {"sent": 100, "received": 70, "dropped": 20 + number, "lead_in": 3}
        progress.add(make_row(f"case-{number}", result={"ledger": ledger}))
    progress.add(make_row("none", result=None))
    progress.add(make_row("other", result={"stack": {}}))
    assert progress.snapshot()["ledger"] == {
        "sent": 200, "received": 140, "dropped": 41, "leadIn": 6,
    }  # fmt: skip


def test_what_another_driver_committed_is_reported_as_it_is() -> None:
    manifest: dict[str, Any] = {
        "phase": "Complete", "reason": "AllCasesRan", "message": "8 of 8 cases ran",
        "verdict": "Failed", "verdictReason": "Failed",
        "counts": {
            "planned": 8, "running": 0, "passed": 4, "failed": 2, "invalid": 1, "errored": 1,
            "crashed": 1, "lost": 2, "discarded": 3, "quarantined": 1, "regressed": 1,
        },
        "ledger": {"sent": 9, "received": 5, "dropped": 3, "leadIn": 1},
        "failures": [{"case": "a", "reason": "Bad", "message": "why a"}],
        "comparisons": [comparison("new", 1)],
    }  # fmt: skip
    progress = Progress("r")
    progress.begin(2)
    progress.set_running(1)
    progress.add(make_row("b", "failed", "Worse"))
    progress.adopt(manifest)
    found = progress.snapshot()
    for name in ("phase", "reason", "message", "verdict", "verdictReason", "ledger", "failures"):
        assert found[name] == manifest[name], name
    assert found["cases"] == manifest["counts"]
    assert [one["variant"] for one in found["comparisons"]] == ["new"]
    assert progress.left() == 0
    # One of an earlier release has neither.
    earlier = {name: value for name, value in manifest.items() if name != "verdictReason"}
    progress.adopt(earlier | {"comparisons": None})
    found = progress.snapshot()
    assert (found["verdictReason"], found["comparisons"]) == ("", [])


def comparison(variant: str, regressed: int) -> dict[str, Any]:
    counts = {"regressed": regressed, "fixed": 2, "flaky": 3, "same": 4, "missing": 0}
    became = {"failed": regressed, "invalid": 0, "errored": 0, "missing": 0}
    return {
        "variant": variant, "baseline": "old", "verdict": "Regressed" if regressed else "Same",
        "counts": counts, "became": became, "criteria": [],
    }  # fmt: skip


def test_what_regressed_in_any_comparison_is_counted_and_decides() -> None:
    progress = Progress("r")
    progress.begin(1)
    progress.add(make_row("a"))
    found = [comparison("one", 5), comparison("two", 6)]
    progress.compare(Compared(found, note="nothing else"))
    assert progress.comparisons == found
    assert progress.finish()
    snapshot = progress.snapshot()
    assert snapshot["cases"] == NOTHING | {
        "planned": 1, "running": 0, "passed": 1, "regressed": 11,
    }  # fmt: skip
    assert snapshot["comparisons"][0] == {
        "variant": "one", "verdict": "Regressed", "regressed": 5, "fixed": 2, "flaky": 3,
    }  # fmt: skip
    assert (snapshot["verdict"], snapshot["verdictReason"]) == ("Failed", "Regressed")
    assert snapshot["message"] == (
        "1 of 1 cases ran, verdict Failed; one against old: 5 regressed (5 failed);"
        " two against old: 6 regressed (6 failed); nothing else"
    )


def test_without_a_case_and_with_one_too_few_a_job_has_no_result() -> None:
    none = ended_with([])
    assert (none["phase"], none["reason"]) == ("Failed", "CasesMissing")
    assert none["message"] == "0 of 0 cases gave no result"
    assert ended_with(["passed"] * 3, planned=4)["message"] == "1 of 4 cases gave no result"
    # A row more than was planned is no row too few.
    assert ended_with(["passed"] * 3, planned=2)["phase"] == "Complete"


def test_a_job_has_ended_when_it_was_first_seen_at_its_end() -> None:
    progress = Progress("r")
    assert progress.ended is None
    progress.finish()
    assert progress.ended is not None
    assert progress.ended >= progress.began
    progress.ended = 5.0
    progress.finish()
    assert progress.ended == 5.0


@pytest.mark.parametrize(
    ("end", "phase", "reason", "message"),
    [
        (lambda job: job.interrupt(), "Running", "Interrupted", "the driver's pod received"),
        (lambda job: job.lose("no Java"), "Running", "SparkGone", "no Java"),
        (lambda job: job.fail("StorageFailed", "no room"), "Failed", "StorageFailed", "no room"),
        (lambda job: job.finish(), "Failed", "CasesMissing", "1 of 2 cases gave no result"),
    ],
)  # fmt: skip
def test_however_a_driver_ends_nothing_runs_any_more(
    end: Callable[[Progress], object], phase: str, reason: str, message: str
) -> None:
    progress = Progress("r", slots=4)
    progress.begin(2)
    progress.set_running(2)
    progress.add(make_row("a"))
    end(progress)
    found = progress.snapshot()
    assert (found["phase"], found["reason"], found["cases"]["running"]) == (phase, reason, 0)
    assert found["message"].startswith(message)


def test_a_warning_has_300_letters_at_most_and_is_none_of_a_job_that_has_ended() -> None:
    progress = Progress("r")
    progress.warn("w" * 300)
    assert progress.warning == "w" * 300
    progress.warn("w" * 301)
    assert progress.warning == f"{'w' * 195} ... {'w' * 100}"
    progress.finish()
    assert progress.warning == ""


@pytest.mark.parametrize("how", ["fail", "stop"])
def test_why_a_job_was_ended_has_600_letters_at_most(how: str) -> None:
    progress = Progress("r")
    for length in (600, 601):
        getattr(progress, how)("Why", "x" * length)
        if how == "stop":
            progress.finish()
        assert len(progress.message) == 600
        assert (" ... " in progress.message) == (length == 601)


RULE = QuarantineRule(cases="flaky-*", reason="issue 17", until=date(2026, 11, 30))
QUARANTINE = Quarantine([RULE], date(2026, 11, 28))


def counted(*rows: tuple[str, str], quarantine: Quarantine = QUARANTINE) -> Progress:
    progress = Progress("r")
    progress.look_at(quarantine)
    progress.begin(len(rows))
    for name, outcome in rows:
        reason = "" if outcome == "passed" else "Bad"
        progress.add(quarantine.marked(make_row(name, outcome, reason, result=None)))
    progress.finish()
    return progress


def test_what_is_in_quarantine_counts_for_nothing_and_is_in_the_sentence() -> None:
    rows = [("a", "passed"), ("flaky-1", "failed"), ("flaky-2", "errored"), ("flaky-3", "passed")]
    progress = counted(*rows)
    found = progress.snapshot()
    assert (progress.failed(), found["phase"], found["verdict"]) == (0, "Complete", "Passed")
    assert found["message"] == (
        "4 of 4 cases ran, verdict Passed; 2 of 3 cases in quarantine did not pass"
    )
    assert found["cases"]["quarantined"] == 2
    assert (progress.quarantine or {})["rules"][0]["errored"] == 1
    assert counted(("a", "failed"), ("b", "errored"), ("flaky-1", "errored")).failed() == 2
    # Without a case in it there is but what somebody has to do.
    assert counted(("a", "passed")).message == (
        "1 of 1 cases ran, verdict Passed; quarantine of 'flaky-*': names no case of this job:"
        " correct its pattern, or remove it"
    )


def test_the_words_about_a_quarantine_are_300_letters_at_most() -> None:
    rules = [RULE.model_copy(update={"cases": f"none-{number}"}) for number in range(9)]
    message = counted(("a", "passed"), quarantine=Quarantine(rules, QUARANTINE.day)).message
    words = message.removeprefix("1 of 1 cases ran, verdict Passed; ")
    assert len(words) == 300
    assert words.startswith("quarantine of 'none-0': names no case of this job")
    assert words.endswith("correct its pattern, or remove it")


def test_five_failures_are_named_and_those_that_count_come_first() -> None:
    flaky = [(f"flaky-{number}", "failed") for number in range(6)]
    progress = counted(*flaky, ("a", "failed"), ("b", "invalid"))
    found = progress.snapshot()["failures"]
    assert [each["case"] for each in found] == ["a", "b", "flaky-0", "flaky-1", "flaky-2"]
    assert found[0] == {"case": "a", "reason": "Bad", "message": "why a"}
    assert found[2]["message"] == "why flaky-0 (in quarantine until 2026-11-30: issue 17)"
    six = counted(*[(f"case-{number}", "failed") for number in range(6)])
    assert [each["case"] for each in six.snapshot()["failures"]] == [
        f"case-{number}" for number in range(5)
    ]
    # Neither list is kept longer than it is shown.
    assert (len(progress._quarantined), len(six._failures)) == (5, 5)


def test_a_case_has_a_hundred_letters_of_its_name_and_its_first_error_eight_hundred() -> None:
    progress = Progress("r")
    progress.begin(2)
    progress.add(make_row("n" * 101, "errored", "Bad", message="x" * 801))
    progress.add(make_row("m" * 101, "errored", "Bad", message="second"))
    progress.finish()
    failures = progress.snapshot()["failures"]
    assert [each["case"] for each in failures] == ["n" * 100, "m" * 100]
    words = f"{'x' * 529} ... {'x' * 266}"
    assert progress.message == f"2 of 2 cases errored; {'n' * 100}: Bad: {words}"
    whole = errored("x" * 800)
    assert whole.message == f"1 of 1 cases errored; case-0: MachineBusy: {'x' * 800}"


def full(results: int) -> Progress:
    """All that may be cut from a termination message, and a results folder with a long name."""
    progress = Progress("r" * results)
    progress.begin(2)
    progress.add(make_row("a", "failed", "Bad", message="a" * 300))
    progress.add(make_row("b", "failed", "Bad", message="b" * 300))
    progress.compare(Compared([comparison("one", 1), comparison("two", 0)]))
    progress.lose("m" * 500)
    progress.warn("w" * 300)
    return progress


def test_a_termination_message_of_4096_bytes_is_whole_and_of_a_longer_one_the_least_is_cut() -> (
    None
):
    room = 4096 - len(json.dumps(full(0).snapshot()))
    assert json.loads(full(room).termination_message()) == full(room).snapshot()
    assert len(full(room).termination_message()) == 4096
    cut = json.loads(full(room + 1).termination_message())
    assert [each["case"] for each in cut["failures"]] == ["a"]
    assert cut | {"failures": []} == full(room + 1).snapshot() | {"failures": []}

    # In this order: what is reported elsewhere too goes first.
    def length(named: str) -> int:
        return len(json.dumps(full(0).snapshot()[named])) - 2

    room += length("failures")
    cut = json.loads(full(room + 1).termination_message())
    assert (cut["failures"], [one["variant"] for one in cut["comparisons"]]) == ([], ["one"])
    room += length("comparisons")
    cut = json.loads(full(room).termination_message())
    assert (cut["comparisons"], cut["warning"], cut["message"]) == ([], "w" * 300, "m" * 500)
    cut = json.loads(full(room + 1).termination_message())
    assert (cut["warning"], cut["message"]) == (f"{'w' * 95} ... {'w' * 50}", "m" * 500)
    room += 300
    cut = json.loads(full(room + 1).termination_message())
    assert (cut["warning"], cut["message"]) == ("", f"{'m' * 162} ... {'m' * 83}")
    # Longer still, it is as short as it can be.
    cut = json.loads(full(5000).termination_message())
    assert (cut["warning"], cut["message"], cut["failures"], cut["comparisons"]) == ("", "", [], [])


def test_a_message_is_shortened_in_its_middle_where_there_is_room_for_that() -> None:
    letters = "abcdefghijklmnopqrstuvwxyz"
    assert shortened(letters, 26) == letters
    assert shortened(letters, 25) == "abcdefghijkl ... stuvwxyz"
    assert shortened(letters, 20) == "abcdefghi ... uvwxyz"
    assert shortened(letters, 19) == "abcdefghijklmnopqrs"


@given(st.text(max_size=400), st.integers(0, 300))
def test_a_shortened_message_has_its_bound_its_beginning_and_its_end(text: str, most: int) -> None:
    short = shortened(text, most)
    assert len(short) == min(len(text), most)
    if 20 <= most < len(text):
        third = most // 3
        assert (short[:third], short[-third:]) == (text[:third], text[-third:])
    else:
        assert short == text[:most]
