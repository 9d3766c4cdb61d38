"""The report's parts: columns, chosen details, courses, words, and a page that holds no tag."""

import itertools
import json
import math
import re
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bagpipe.report.baselines import Baselines
from bagpipe.report.causes import MOST_CAUSES, Causes
from bagpipe.report.columns import Columns, limits_of
from bagpipe.report.details import Details, detail_of, fitting
from bagpipe.report.html import Report, regressed_cases, render
from bagpipe.report.series import series_of
from bagpipe.report.spool import Spool
from bagpipe.report.words import headline, sentence
from bagpipe.row_facts import verdict_words
from bagpipe.storage import StorageError
from tests.unit.bagpipe.jobs import make_row

COUNTS = {
    "planned": 5, "passed": 2, "failed": 2, "invalid": 1, "errored": 0, "crashed": 0, "lost": 0,
    "regressed": 0, "discarded": 0,
}  # fmt: skip
MANIFEST = {
    "job": {"name": "n", "namespace": "lab", "uid": "u"}, "attempt": 1, "phase": "Complete",
    "verdict": "Failed", "message": "m", "counts": COUNTS,
    "ledger": {"sent": 3, "received": 3, "dropped": 0, "leadIn": 0},
}  # fmt: skip


def finding(outcome: str, figure: float | None, name: str = "rate") -> dict[str, Any]:
    return {"name": name, "kind": "rate", "outcome": outcome, "figure": figure, "unit": "Hz",
            "limit": "at least 9 Hz", "message": "text"}  # fmt: skip


def test_columns_say_each_word_once_and_keep_the_order_of_the_job() -> None:
    columns = Columns(["released", "new"])
    columns.add(make_row("b", variant="new", scenario=1, values={"rain": "on"}))
    columns.add(
        make_row("a", "failed", "Bad", variant="new", scenario=0, values={"rain": "off"},
                 criteria=[finding("failed", 3.123456789)])
    )  # fmt: skip
    columns.add(make_row("c", "errored", "Bad", criteria=[finding("invalid", math.inf)]))
    shown = columns.as_json()
    cases = shown["cases"]
    assert (cases["case"], cases["outcome"]) == (["a", "b", "c"], "FPE")
    assert cases["variant"] == {"values": ["released", "new", ""], "at": [1, 1, 2]}
    assert cases["reason"] == {"values": ["Bad", ""], "at": [0, 1, 0]}
    assert shown["variables"] == [{"name": "rain", "values": ["off", None, "on"], "at": [0, 2, 1]}]
    [criterion] = shown["criteria"]
    assert (criterion["outcomes"], criterion["figures"]) == ("F-I", [3.1235, None, None])
    assert (criterion["low"], criterion["high"]) == (9, None)
    json.dumps(shown, allow_nan=False)


def test_a_page_has_room_first_for_what_did_not_pass() -> None:
    columns = Columns(most_cases=10)
    for n in range(30):
        columns.add(make_row(f"a-{n:02d}", "failed" if n in {3, 28, 29} else "passed"))
    shown = columns.as_json()
    assert (shown["counted"], len(shown["cases"]["case"])) == (30, 10)
    assert shown["cases"]["outcome"].count("F") == 3


def test_all_messages_together_have_a_bound() -> None:
    columns = Columns()
    for n in range(20_000):
        columns.add(make_row(f"a-{n}", "failed", "Bad", message=f"{n} " + "x" * 1000))
    assert len(json.dumps(columns.as_json())) < 5_000_000


@pytest.mark.parametrize(
    ("text", "limits"),
    [
        ("at least 9 Hz", (9, None)),
        ("at most 1e-05 s", (None, 1e-05)),
        ("-0.5 to 0.5", (-0.5, 0.5)),
        ("at most a lot", (None, None)),
        ("", (None, None)),
    ],
)
def test_limits_are_read_as_findings_write_them(
    text: str, limits: tuple[float | None, float | None]
) -> None:
    assert limits_of(text) == limits


def test_fifty_of_one_kind_do_not_hide_the_others() -> None:
    details = Details(Spool())
    for n in range(100):
        details.add(make_row(f"a-{n:03d}", "failed", "CriterionFailed"))
    details.add(make_row("z-1", "errored", "StackExited"))
    details.add(make_row("z-2", "failed", "CriterionFailed", criteria=[finding("failed", 1.0)]))
    details.add(make_row("z-3"))
    names = details.listed()
    assert (len(names), names[-2:]) == (50, ["z-1", "z-2"])


def test_what_regressed_is_shown_in_full_first() -> None:
    compared = [{"regressed": [{"case": "z-7", "to": "failed", "reason": "X"}]}]
    for named in (compared, [{"regressed": ["z-7"]}]):  # as v1alpha1 has it
        assert regressed_cases(named) == ["z-7"]
    details = Details(Spool(), regressed=["z-7"])
    for n in range(100):
        details.add(make_row(f"a-{n:03d}", "failed", "CriterionFailed"))
    details.add(make_row("z-7", "failed", "CriterionFailed"))
    details.add(make_row("z-8", "errored", "AgentDied"))
    names = details.listed()
    assert (len(names), names[0], names[-1]) == (50, "z-7", "z-8")


def long_row(name: str, outcome: str, **more: Any) -> dict[str, Any]:
    """A row with a course of some 1.2 KB."""
    points = [[n / 10, n * 1.001] for n in range(100)]
    found = finding(outcome, 1.0) | {"course": {"label": "x", "low": 1, "points": points}}
    return make_row(name, outcome, criteria=[found], **more)


def test_room_goes_to_what_did_not_pass_then_to_what_changed_then_to_a_sample() -> None:
    details = Details(Spool(), changed=["p-050", "p-051"], most_bytes=100_000)
    names = []
    for n in range(300):
        for name, outcome in ((f"f-{n:03d}", "failed"), (f"p-{n:03d}", "passed")):
            details.add(long_row(name, outcome))
            names.append(name)
    shown = details.in_full(names)
    sizes = {name: len(json.dumps(detail)) for name, detail in shown.items()}
    failed = [name for name in shown if name[0] == "f"]
    assert sum(sizes[name] for name in failed) == pytest.approx(70_000, abs=3000)
    passed = list(shown)[len(failed) :]
    assert set(passed[:2]) == {"p-050", "p-051"}
    assert sum(sizes.values()) == pytest.approx(100_000, abs=3000)
    assert sum(sizes.values()) <= 100_000
    # A sample, and no stretch of names; the same each time.
    numbers = sorted(int(name[2:]) for name in passed[2:])
    assert (len(numbers), numbers[0] < 60, numbers[-1] > 240) == (len(passed) - 2, True, True)
    assert list(details.in_full(names)) == list(shown)
    assert list(details.in_full(["p-007"])) == ["p-007"]


def test_a_case_that_is_too_large_loses_its_last_courses() -> None:
    row = long_row("a", "failed")
    row["criteria"] *= 60
    detail, size = fitting(detail_of(row))
    assert 60_000 < size <= 64_000
    assert detail["left"] + len(detail["series"]) == 60


_NUMBER = st.one_of(
    st.floats(width=16), st.integers(-3, 3), st.booleans(), st.sampled_from([10**400, "1", None])
)
_POINT = st.one_of(
    st.lists(st.floats(0, 9), min_size=2, max_size=2), st.lists(_NUMBER, max_size=3),
    st.tuples(st.just(1.0), st.just(2.0)), st.just("ab"), st.just({"x": 1, "y": 2}),
)  # fmt: skip


@given(st.lists(_POINT, max_size=6))
@example([[1.0, 2.0], [1.0, math.nan]])
@example([[1.0, 2.0], [True, 1.0]])
@example([[1.0, 2.0], [10**400, 1]])
@example([[1.0, 2.0], (1.0, 2.0)])
@example([[1.0, 2.0], [1.0, 2.0, 3.0], [1.0]])
def test_a_course_keeps_all_points_that_are_two_finite_numbers_and_no_other(
    points: list[Any],
) -> None:
    found = finding("failed", 1.0) | {"course": {"points": points}}
    [drawn] = series_of(make_row("a", "failed", criteria=[found]))
    assert drawn["points"] == [
        point for point in points
        if isinstance(point, list) and len(point) == 2
        and all(type(each) in (int, float) and abs(each) < 1e300 for each in point)
    ]  # fmt: skip


def test_a_course_has_400_points_at_most() -> None:
    for points in ([[n, 1.0] for n in range(500)], [[True, 1.0], *([n, 1.0] for n in range(500))]):
        found = finding("failed", 1.0) | {"course": {"points": points}}
        [drawn] = series_of(make_row("a", "failed", criteria=[found]))
        assert drawn["points"] == [[n, 1.0] for n in range(400)]


def test_what_a_course_holds_is_checked() -> None:
    evil: dict[str, Any] = {
        "label": "l" * 900, "unit": 7, "low": math.nan, "high": "x", "step": 1,
        "points": [
            [0, 1], [1], "ab", [math.inf, 1], [2, math.nan], [3, 10**400], [4, True], [5, 5.0],
        ],
        "odd": [1, None, math.inf, "x"],
    }  # fmt: skip
    others: list[Any] = [evil, 7, [], {"points": 7}, {"points": None, "odd": 3}]
    rows = [make_row("a", "failed", criteria=[finding("failed", 1.0) | {"course": course}])
            for course in others]  # fmt: skip
    shown = [series_of(row) for row in rows]
    assert shown[0] == [{
        "criterion": "rate", "outcome": "failed", "label": "l" * 200, "unit": "7", "step": True,
        "moment": 1, "points": [[0, 1], [5, 5.0]], "odd": [1], "low": None, "high": None,
    }]  # fmt: skip
    assert (shown[1], shown[2]) == ([], [])
    path = {"name": 7, "points": [[0, 1, 2], [0, 1], [0, math.nan, 1], "abc", [1, 2, 3]]}
    odd = {"points": [], "plane": {"paths": [path, 7, path, path], "goal": [1, 2, -3]}}
    [drawn] = series_of(
        make_row("a", "failed", criteria=[finding("failed", 1.0) | {"course": odd}])
    )
    assert drawn["plane"] == {
        "paths": [{"name": "7", "points": [[0, 1, 2], [1, 2, 3]]}], "goal": None,
    }  # fmt: skip
    assert [each["points"] for found in shown[3:] for each in found] == [[], []]


def test_lines_with_a_time_of_the_clock_are_on_the_axis() -> None:
    window = [1_000_000_000_000, 1_005_000_000_000, 1_025_000_000_000]
    stderr = [
        "[ WARN] [1700000000.123456789, 1006.500000000]: slow",
        "\x1b[31m[ERROR] [1700000001.000001, 1006.25]: lost\x1b[0m",
        "[INFO] [1700000000.123, 999.999]: before it began",
        "[INFO] [1700000000.123456789] [node]: of the wall's time alone",
        "[FATAL] [1700000000.1, 99999999999999.1]: no time",
        "Traceback (most recent call last):",
    ]
    row = make_row("a", "failed", "StackCrashed", stderr=stderr, window=window)
    assert detail_of(row)["lines"] == [
        {"at": 1.25, "level": "error", "text": "lost"},
        {"at": 1.5, "level": "warn", "text": "slow"},
    ]
    assert detail_of(row)["stderr"] == stderr
    assert detail_of(row | {"window": None})["lines"] == []
    evil: list[Any] = [7, None, {"at": math.nan}, {"at": "1"}, {"at": 2, "level": "<b>"}]
    logged = [{"at": 1.0, "level": "warn", "node": "/n", "text": "t" * 900}, *evil]
    lines = detail_of(row | {"log": logged})["lines"]
    assert [(line["at"], line["level"]) for line in lines] == [(1.0, "warn"), (2, "info")]
    assert lines[0]["text"] == ("/n: " + "t" * 900)[:300]


def test_no_figure_of_a_row_keeps_the_page_from_being_made() -> None:
    topic = {"topic": "/a", "sent": math.nan, "subscribers": [{"node": "/n", "received": math.inf}]}
    ledger = {"sent": math.inf, "topics": [topic]}
    result = {
        "ledger": ledger, "timings": {"play": math.inf}, "machine": {"late_max_seconds": math.nan},
    }  # fmt: skip
    row = long_row("a", "failed", window=[1, 2.5, "x"], result=result)
    report = Report(None, "r")
    report.add(row)
    page = report.html(MANIFEST).decode()
    assert "NaN" not in page
    assert detail_of(row)["window"] is None


def test_delivery_and_timings_of_every_case_are_in_columns() -> None:
    columns = Columns()
    ledger = {"sent": 1_234_567, "received": 3, "dropped": 0}
    result = {"ledger": ledger, "timings": {"play": 20.04}}
    columns = Columns()
    columns.add(make_row("a", result=result))
    columns.add(make_row("b", result=None))
    shown = columns.as_json()
    assert [shown["cases"][name] for name in ("sent", "received", "dropped")] == [
        [1_234_567, None], [3, None], [0, None],
    ]  # fmt: skip
    assert shown["timings"] == {"play": [20.0, None]}


def baseline_of(rows: list[dict[str, Any]], first: str | None = "old") -> dict[str, Any]:
    spool = Spool()
    details, baselines = Details(spool), Baselines(spool, first)
    for row in rows:
        details.add(row)
        baselines.add(row)
    shown = details.in_full([row["case"] for row in rows if row["variant"] == "new"])
    return baselines.of(shown)


def test_the_baseline_is_the_same_round_of_the_same_case() -> None:
    rows = [
        long_row(f"{variant}-{rain}-{n}", "failed", variant=variant, fragment="f",
                 values={"rain": rain}, seed=3, round=n)
        for variant, rain, n in itertools.product(("old", "new"), (0, 1), (0, 1))
    ]  # fmt: skip
    found = baseline_of(rows)
    assert {name: each["case"] for name, each in found.items()} == {
        f"new-{rain}-{n}": f"old-{rain}-{n}" for rain in (0, 1) for n in (0, 1)
    }
    assert found["new-1-0"]["called"] == "old"
    assert [each["criterion"] for each in found["new-1-0"]["series"]] == ["rate"]
    assert baseline_of(rows, None) == {}
    assert baseline_of([row for row in rows if row["variant"] == "new"]) == {}


def test_an_earlier_job_s_courses_are_laid_over_and_have_a_bound() -> None:
    report = Report(None, "r")
    for n in range(3):
        report.add(long_row(f"a-{n}", "failed", fragment=f"a-{n}"))
    report.add_earlier(long_row(f"b-{n}", "passed", fragment=f"a-{n}") for n in (1, 2, 7))
    page = report.html(MANIFEST).decode()
    data = re.search(r'id="data">(.*?)</script>', page, re.DOTALL)
    assert data is not None
    found = json.loads(data[1])["baselines"]
    assert {name: each["case"] for name, each in found.items()} == {"a-1": "b-1", "a-2": "b-2"}
    assert found["a-1"]["called"] == "the earlier job"
    assert len(found["a-1"]["series"][0]["points"]) == 100
    spool = Spool()
    details, baselines = Details(spool), Baselines(spool, None, most_bytes=5000)
    rows = [long_row(f"a-{n}", "passed") for n in range(9)]
    for row in rows:
        details.add(row)
    assert len(baselines.of_earlier([row["case"] for row in rows], rows)) == 2


def test_an_earlier_job_that_breaks_off_costs_its_courses_alone() -> None:
    def rows() -> Iterator[dict[str, Any]]:
        yield long_row("a-1", "passed")
        raise StorageError("gone")

    report = Report(None, "r")
    report.add(long_row("a-1", "failed"))
    with pytest.raises(StorageError):
        report.add_earlier(rows())
    assert b'"baselines":{}' in report.html(MANIFEST)


def test_cases_that_share_a_cause_are_one_line() -> None:
    causes = Causes()
    for n in range(30):
        message = f"lane rate: {n / 7:.3g} Hz on /lane of drive-{n}, and may be at least 9 Hz"
        causes.add(make_row(f"drive-{n}", "failed", "CriterionFailed", message=message,
                            criteria=[finding("failed", n, "lane rate")]))  # fmt: skip
    for n, signal in enumerate([11, 11, 6]):
        message = f"lane_node ended by signal {signal} at 0x7f{n}a after {n}.5 s"
        causes.add(make_row(f"b-{n}", "failed", "StackCrashed", message=message))
    causes.add(make_row("c", "passed"))
    shown = causes.as_json(["c", "b-1", "drive-3"])
    assert [(g["count"], g["reason"], g["criteria"], g["first"]) for g in shown["groups"]] == [
        (30, "CriterionFailed", ["lane rate"], "drive-0"),
        (2, "StackCrashed", [], "b-0"),
        (1, "StackCrashed", [], "b-2"),
    ]
    assert shown["groups"][1]["message"] == "lane_node ended by signal 11 at 0x7f0a after 0.5 s"
    assert shown["at"] == [-1, 1, 0]


def test_causes_without_end_stand_together_by_reason() -> None:
    causes = Causes()
    for n in range(20_000):
        word = "".join(chr(ord("g") + int(digit)) for digit in str(n))
        causes.add(make_row(f"a-{n}", "failed", "Bad", message=f"it wrote {word}"))
    groups = causes.as_json([])["groups"]
    assert (len(groups), groups[0]["message"]) == (MOST_CAUSES + 1, "other messages")
    assert sum(group["count"] for group in groups) == 20_000


def test_discarded_runs_and_the_machine_are_in_a_case_s_details() -> None:
    busy = {"reason": "MachineBusy", "message": "late", "seconds": 5.0}
    node = {"node": "/n", "received": 3, "strength": "received", "queue": 2}
    ledger = {"strength": "received", "topics": [{"topic": "/a", "sent": 3, "subscribers": [node]}]}
    machine = {"late_max_seconds": 0.2, "steal_seconds": None, "busy": True, "message": "it was"}
    shown = detail_of(
        make_row("a", "failed", "MessagesLost", discarded=[busy, "AgentDied"],
                 result={"ledger": ledger, "machine": machine})
    )  # fmt: skip
    assert shown["discarded"] == ["MachineBusy after 5.0 s: late", "AgentDied"]
    assert shown["strength"] == "received"
    assert (shown["ledger"][0]["strength"], shown["ledger"][0]["queue"]) == ("received", 2)
    assert shown["machine"] == {"message": "it was", "figures": {"late max": 0.2}}
    columns = Columns()
    columns.add(make_row("a", discarded=[busy, busy, "AgentDied"], attempts=4))
    shown = columns.as_json()["cases"]["discarded"]
    assert shown["values"] == ["2 x MachineBusy, 1 x AgentDied"]


@pytest.mark.parametrize(
    ("verdict", "counts", "words"),
    [
        ("Passed", {"passed": 4}, "Passed"),
        (
            "Failed",
            {"failed": 30, "regressed": 6, "crashed": 3},
            "Failed: 30 failed, 6 regressed, 3 crashed",
        ),
        ("Invalid", {"invalid": 2, "passed": 1}, "Invalid: 2 lack evidence"),
        ("Passed", {"failed": 1, "quarantined": 1}, "Passed: 1 failed, 1 of these in quarantine"),
        ("", {"errored": 1200, "lost": 1}, "No verdict: 1 lost messages, 1,200 errored"),
    ],
)
def test_the_headline_says_all_of_it(verdict: str, counts: dict[str, int], words: str) -> None:
    assert verdict_words(verdict, counts) == words


def test_a_detail_has_bounds() -> None:
    topic = {"topic": "/a", "sent": 1, "subscribers": [{"node": f"/{n}"} for n in range(100)]}
    row = make_row(
        "a", "failed", "Bad", message="m" * 9000, stderr=["e" * 900] * 200,
        result={"ledger": {"topics": [topic] * 100}, "timings": {"play": 1.0, "odd": "x"}},
    )  # fmt: skip
    shown = detail_of(row)
    assert (len(shown["message"]), len(shown["stderr"]), len(shown["stderr"][0])) == (4000, 40, 500)
    assert (len(shown["ledger"]), shown["timings"]) == (1000, {"play": 1.0})


def test_what_users_should_know_of_the_way_a_case_was_played_stands_beside_its_delivery() -> None:
    pace = "/slow set the pace"
    played = {"warnings": ["/two subscribes to /a as another type"], "pace": pace}
    shown = detail_of(make_row("a", result={"playback": played}))
    assert shown["notes"] == ["/two subscribes to /a as another type", pace]
    long = {"warnings": ["w" * 900] * 30, "pace": None}
    notes = detail_of(make_row("a", result={"playback": long}))["notes"]
    assert (len(notes), {len(note) for note in notes}) == (20, {500})
    assert detail_of(make_row("a"))["notes"] == []


def test_the_evidence_of_a_case_that_does_not_count_is_shown() -> None:
    topic = {"topic": "/a", "sent": 3, "subscribers": [{"node": "/n", "received": 2}]}
    evidence = {"ledger": {"topics": [topic]}}
    lossy = detail_of(make_row("a", "errored", "MachineBusy", evidence=evidence))
    assert [(line["node"], line["received"]) for line in lossy["ledger"]] == [("/n", 2)]
    starts = [{"executor": str(n), "host": "h", "seconds": 1.0, "error": "e" * 900} for n in (1, 2)]
    lost = detail_of(make_row("b", "errored", "ExecutorLost", evidence={"starts": starts}))["lost"]
    assert [line[:29] for line in lost] == [
        f"executor {n} at h after 1.0 s: ee"[:29] for n in (1, 2)
    ]
    assert {len(line) for line in lost} == {500}
    assert detail_of(make_row("c", "failed", "Bad"))["lost"] == []


def test_words_name_the_criteria_that_failed_most() -> None:
    columns = Columns()
    for n in range(2):
        columns.add(
            make_row(f"a-{n}", "failed", "CriterionFailed", criteria=[finding("failed", 1)])
        )
    data = columns.as_json()
    summary = sentence(MANIFEST, data)
    assert summary == "Of 5 cases 2 failed and 1 lack evidence. Most often: rate (2)."
    assert headline(MANIFEST) == ("failed", "Failed", "2 failed, 1 lack evidence")
    broken = MANIFEST | {"verdict": "", "message": "the volume is full"}
    assert (headline(broken)[1], sentence(broken, data)) == ("No verdict", "the volume is full")


@settings(deadline=None)  # the machine may be busy, and time is not what is tested
@example("</script></title><script>x()</script><img src=x onerror=x()>")
@example("' onclick=x() \"><script>x()</script><!--")
@given(st.text(max_size=60))
def test_no_text_leaves_its_place(text: str) -> None:
    report = Report(None, "pvc://results/x")
    report.add(
        make_row(
            text + "a", "failed", text, message=text, stderr=[text], variant=text,
            values={text: text}, criteria=[finding("failed", 1.0, text)],
        )
    )  # fmt: skip
    page = report.html(MANIFEST | {"job": {"name": text, "namespace": text, "uid": text}}).decode()
    assert len(re.findall(r"<script", page)) == 2
    assert len(re.findall(r"<(?:img|iframe|link|object|embed|base|form)\b", page)) == 0
    data = re.search(r'id="data">(.*?)</script>', page, re.DOTALL)
    assert data is not None
    assert not set("<>&") & set(data[1])
    assert json.loads(data[1])["cases"]["case"] == [text + "a"]


def test_the_scripts_set_text_only_and_ask_for_nothing() -> None:
    page = render(
        {}, job=MANIFEST["job"], headline=("failed", "Failed", ""), sentence="s", manifest=MANIFEST,
        comparisons=[], provenance=[], quarantine=[], results="r", stack_seconds=0.0,
    ).decode()  # fmt: skip
    for word in ("innerHTML", "outerHTML", "insertAdjacent", "document.write", "eval(", "fetch(",
                 "XMLHttp", "import(", "localStorage", " style=", "url("):  # fmt: skip
        assert word not in page, word
    assert "default-src 'none'; script-src 'sha256-" in page
    assert "unsafe" not in page
