"""The results in other forms: JUnit XML as a CI reads it, Parquet as an analyst does."""

import io
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pyarrow.parquet as pq
from hypothesis import given
from hypothesis import strategies as st

from bagpipe.report.junit import kept, write_junit
from bagpipe.report.table import SCHEMA, TableWriter
from tests.unit.bagpipe.jobs import make_row

FAILED = {
    "name": "lane rate", "kind": "rate", "outcome": "failed", "figure": 3.5, "unit": "Hz",
    "limit": "at least 9 Hz", "direction": "higher", "message": "3.5 Hz & <less>",
    "expected_failure": False, "coverage": 1.0,
    "covered": "of the whole window", "clock": "receipt",
}  # fmt: skip

MANIFEST = {
    "job": {"name": "nightly", "namespace": "lab", "uid": "u"},
    "counts": {"discarded": 3},
    "provenance": {
        "bagpipe": "0.1.0", "agents": ["bagpipe-agent 0.1.0"],
        "labels": {"branch": "main"}, "annotations": {"sim.bagpipe.io/commit": "0c1f"},
        "began": "2026-11-21T04:00:00Z", "ended": "2026-11-21T04:10:00Z", "seconds": 600.0,
        "images": [{"container": "stack", "image": "lane:1", "digest": "lane@sha256:aa",
                    "pods": 2}],
        "machines": [{"cpu": "EPYC", "arch": "x86_64", "kernel": "6.1", "cpus": 8, "cases": 4,
                      "names": ["node-1"]}],
        "seeds": [0, 1], "discarded": {"MachineBusy": 3},
    },
}  # fmt: skip


def junit(*rows: dict[str, Any]) -> ET.Element:
    file = io.BytesIO()
    write_junit(file, MANIFEST, [kept(row) for row in rows])
    return ET.fromstring(file.getvalue())  # noqa: S314  our own text


def test_each_variant_is_a_suite_and_each_case_a_test() -> None:
    root = junit(
        make_row("a-0000", variant="pr-812", fragment="a-0000", seconds=2.5),
        make_row("a-0001", "failed", "CriterionFailed", variant="pr-812", criteria=[FAILED]),
        make_row("a-0002", "invalid", "NotEnoughEvidence", variant="released"),
        make_row("a-0003", "errored", "StackExited", variant="released", stderr=["a < b"]),
    )
    assert [suite.get("name") for suite in root] == ["pr-812", "released"]
    cases = {case.get("name"): case for case in root.iter("testcase")}
    assert list(cases) == ["a-0000", "a-0001", "a-0002", "a-0003"]
    assert (cases["a-0000"].get("time"), len(cases["a-0000"])) == ("2.500", 0)
    assert [[s.get(k) for k in ("tests", "failures", "errors", "time")] for s in root] == [
        ["2", "1", "0", "2.500"], ["2", "0", "2", "0.000"],
    ]  # fmt: skip
    failure = cases["a-0001"].find("failure")
    assert failure is not None
    assert (failure.get("type"), failure.get("message")) == ("CriterionFailed", "why a-0001")
    assert cases["a-0001"].findtext("system-out") == "lane rate: failed 3.5 Hz & <less>"
    for name in ("a-0002", "a-0003"):
        assert cases[name].find("error") is not None
    assert cases["a-0003"].findtext("system-out") == "stderr: a < b"


def test_what_is_in_quarantine_is_skipped_with_all_that_it_did() -> None:
    mark = {"cases": "a*", "reason": "issue 17", "until": "2026-12-31"}
    root = junit(
        make_row("a-0", "failed", "StackCrashed", quarantine=mark, stderr=["core"]),
        make_row("a-1", quarantine=mark),
        make_row("a-2", "errored", "StackNeverExited", quarantine=mark),
        make_row("b-0", "failed", "Bad"),
    )
    [suite] = root
    counts = [suite.get(k) for k in ("tests", "failures", "errors", "skipped")]
    assert counts == ["4", "1", "0", "2"]
    cases = {case.get("name"): case for case in root.iter("testcase")}
    skipped = {name: case.find("skipped") for name, case in cases.items()}
    messages = {name: each.get("message") for name, each in skipped.items() if each is not None}
    assert messages == {
        "a-0": "in quarantine until 2026-12-31: issue 17; failed: StackCrashed: why a-0",
        "a-2": "in quarantine until 2026-12-31: issue 17; errored: StackNeverExited: why a-2",
    }
    assert cases["a-0"].findtext("system-out") == "stderr: core"
    facts = {name: case.find("properties/property") for name, case in cases.items()}
    shown = {name: fact.get("value") for name, fact in facts.items() if fact is not None}
    assert shown == dict.fromkeys(("a-0", "a-1", "a-2"), "in quarantine until 2026-12-31: issue 17")


def test_where_the_results_come_from_is_a_property_of_each_suite() -> None:
    busy = {"reason": "MachineBusy", "message": "late by 80 ms", "seconds": 5.25}
    root = junit(make_row("a", discarded=[busy, "AgentDied"]), make_row("b", variant="pr-812"))
    for suite in root:
        assert suite.get("timestamp") == "2026-11-21T04:00:00"
        facts = {p.get("name"): p.get("value") for p in suite.findall("properties/property")}
        assert facts == {
            "label branch": "main", "sim.bagpipe.io/commit": "0c1f",
            "began": "2026-11-21T04:00:00Z", "ended": "2026-11-21T04:10:00Z", "seconds": "600.0",
            "bagpipe": "0.1.0", "agent": "bagpipe-agent 0.1.0",
            "image stack": "lane:1 = lane@sha256:aa (2 pods)",
            "machine": "EPYC, 8 processors, x86_64, Linux 6.1: 4 cases on node-1",
            "seeds": "0, 1", "discarded MachineBusy": "3", "discarded runs": "3",
        }  # fmt: skip
    found = root.findall("testsuite/testcase[@name='a']/properties/property")
    assert [(each.get("name"), each.get("value")) for each in found] == [
        ("discarded", "MachineBusy after 5.2 s: late by 80 ms"), ("discarded", "AgentDied"),
    ]  # fmt: skip


def test_a_job_without_cases_is_a_document_still_and_not_green() -> None:
    [suite] = junit()
    assert (suite.get("name"), suite.get("tests"), suite.get("errors")) == (
        "verdict of the job", "1", "1",
    )  # fmt: skip


@given(st.text(max_size=40))
def test_any_text_makes_a_document(text: str) -> None:
    root = junit(make_row("a", "failed", "X", message=text, stderr=[text]))
    assert root.find(".//failure") is not None


def test_the_table_has_a_line_per_case(tmp_path: Path) -> None:
    writer = TableWriter(tmp_path / "t.parquet")
    rows = [
        make_row(
            f"a-{n:05d}",
            window=[1, 2, 3],
            values={"rain": "on", "speed": n},
            criteria=[FAILED],
            seconds=0.5,
        )
        for n in range(20_001)
    ]
    rows.append(make_row("b", "errored", "BagMissing", attempts=0))
    for row in rows:
        writer.add(row)
    writer.finish()
    table = pq.read_table(tmp_path / "t.parquet")
    assert table.schema.equals(SCHEMA)
    assert (table.num_rows, pq.ParquetFile(tmp_path / "t.parquet").num_row_groups) == (20_002, 3)
    first = table.slice(0, 1).to_pylist()[0]
    assert (first["window_start_ns"], first["window_end_ns"], first["sent"]) == (2, 3, 3)
    assert json.loads(first["values"]) == {"rain": "on", "speed": 0}
    assert (first["criteria"][0]["name"], first["criteria"][0]["figure"]) == ("lane rate", 3.5)
    last = table.slice(20_001, 1).to_pylist()[0]
    assert (last["case"], last["sent"], last["criteria"]) == ("b", None, [])
