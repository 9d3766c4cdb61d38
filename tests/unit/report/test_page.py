"""The report's parts: columns, chosen details, courses, words, and a page that holds no tag."""

import json
import math
import re
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bagpipe.report.causes import MOST_CAUSES, Causes
from bagpipe.report.columns import Columns, limits_of
from bagpipe.report.details import Details, detail_of
from bagpipe.report.html import Report, regressed_cases, render
from bagpipe.report.words import headline, sentence
from bagpipe.row_facts import verdict_words
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
    details = Details()
    for n in range(100):
        details.add(make_row(f"a-{n:03d}", "failed", "CriterionFailed"))
    details.add(make_row("z-1", "errored", "StackExited"))
    details.add(make_row("z-2", "failed", "CriterionFailed", criteria=[finding("failed", 1.0)]))
    details.add(make_row("z-3"))
    names = [row["case"] for row in details.rows()]
    assert (len(names), names[-2:]) == (50, ["z-1", "z-2"])


def test_what_regressed_is_shown_in_full_first() -> None:
    compared = [{"regressed": [{"case": "z-7", "to": "failed", "reason": "X"}]}]
    for named in (compared, [{"regressed": ["z-7"]}]):  # as v1alpha1 has it
        assert regressed_cases(named) == ["z-7"]
    details = Details(regressed=["z-7"])
    for n in range(100):
        details.add(make_row(f"a-{n:03d}", "failed", "CriterionFailed"))
    details.add(make_row("z-7", "failed", "CriterionFailed"))
    details.add(make_row("z-8", "errored", "AgentDied"))
    names = [row["case"] for row in details.rows()]
    assert (len(names), names[0], names[-1]) == (50, "z-7", "z-8")


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
