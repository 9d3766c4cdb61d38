"""Parts of logs: which lines belong to a case, where they come from, and why there are none."""

from pathlib import Path
from typing import Any

import pytest

from bagpipe.cli.cluster.case_lines import of_all, of_case
from bagpipe.cli.cluster.faults import ClusterError
from bagpipe.cli.cluster.pod_logs import driver_log, executor_logs, kept
from bagpipe.cli.cluster.state import JobState
from bagpipe.driver.journal import Journal
from bagpipe.driver.keep import Keeper
from bagpipe.driver.progress import Progress
from bagpipe.driver.row_file import RowFile
from bagpipe.plan.made import Unplanned
from bagpipe.run.case_run import unplanned_row
from bagpipe.storage import Storage
from tests.unit.bagpipe.jobs import make_row
from tests.unit.cli.cluster_objects import FakePods, a_job, ended, running

LOG = """\
bagpipe-agent: 2 slots
[slot 0 case a-1 rosmaster] started
[slot 0 case a-1 stack] loading [the map]
[slot 1 case a-10 stack] another case
[slot 0 case a-1 stack] crashed
[slot 0] StackExited: exit status 3
[slot 1] SlotBusy: of the other case
[slot 0 case a-2 stack] next
[slot 0] of the next
"""
STATE = JobState.of(running())
UNPLANNED = Unplanned("cut", "pvc://r/cut.bag", "BagCut", "its end is missing")


def test_the_lines_of_a_case_are_its_own() -> None:
    assert of_case(LOG, "a-1", "stack", "ros1") == ["loading [the map]", "crashed"]
    assert of_case(LOG, "a-1", "agent", "ros1") == [
        "rosmaster: started",
        "StackExited: exit status 3",
    ]
    assert of_case(LOG, "a-10", "stack", "ros1") == ["another case"]
    assert of_case(LOG, "a-2", "agent", "ros1") == ["of the next"]


def test_with_exec_the_lines_without_a_program_are_the_stack_s() -> None:
    log = "[slot 0 case a-1] starting\n"
    assert of_case(log, "a-1", "stack", "exec") == ["starting"]
    assert of_case(log, "a-1", "stack", "ros1") == []
    assert of_case(log, "a-1", "agent", "ros1") == ["starting"]


def test_all_lines_name_their_case() -> None:
    assert of_all(LOG, "agent", "ros1")[:2] == [
        "bagpipe-agent: 2 slots",
        "[a-1] rosmaster: started",
    ]
    assert of_all(LOG, "stack", "ros1")[-1] == "[a-2] next"


def test_the_results_keep_how_a_case_ended_and_the_stack_s_last_lines() -> None:
    row = make_row("a-1", "errored", "StackExited") | {"stderr": ["boom"]}
    found = kept(row, "s3://r/results.jsonl")
    assert [(p.of, p.lines) for p in found] == [
        ("outcome", ["errored StackExited", "why a-1"]),
        ("stack stderr", ["boom"]),
    ]
    assert found[1].source == "s3://r/results.jsonl, the last lines"


def test_a_case_that_was_answered_keeps_both_streams() -> None:
    stack = {"stdout": ["out"], "stderr": ["err"]}
    found = kept(make_row("a-1") | {"result": {"stack": stack}}, "here")
    assert [(p.of, p.lines) for p in found[1:]] == [
        ("stack stdout", ["out"]),
        ("stack stderr", ["err"]),
    ]


def test_a_case_that_was_given_up_lists_its_lost_starts() -> None:
    start = {"executor": "3", "host": "10.0.0.7", "seconds": 12.34, "error": "exit code 137\n(OOM)"}
    unknown = {"executor": "4", "host": "10.0.0.8", "seconds": None, "error": ""}
    row = make_row("a-1", "errored", "ExecutorLost", evidence={"starts": [start, unknown]})
    (_, lost) = kept(row, "here")
    assert (lost.of, lost.lines) == (
        "lost starts",
        [
            "executor 3 at 10.0.0.7 after 12.3 s: exit code 137 (OOM)",
            "executor 4 at 10.0.0.8: Spark does not say why",
        ],
    )


def test_a_silent_stack_is_reported_as_silent() -> None:
    assert kept(make_row("a-1"), "here")[1].missing == "the stack wrote nothing in this case"


def test_the_lines_of_a_case_come_from_the_executor_that_ran_it() -> None:
    pods = FakePods({("e-1", "stack"): "[slot 0 case a-9 stack] x", ("e-2", "stack"): LOG})
    (part,) = executor_logs(pods, STATE, "stack", 1, "a-1", "ros1")
    assert (part.source, part.lines) == ("pod e-2, container stack", ["crashed"])


def test_a_job_of_a_pool_is_searched_in_the_pods_that_it_took() -> None:
    asked: list[str] = []

    class Asked(FakePods):
        def pods(self, uid: str, role: str) -> list[dict[str, Any]]:
            asked.append(uid)
            return super().pods(uid, role)

    for pool, attempt in (
        ({}, 1), ({"state": "Taken", "uid": "the-first"}, 1), ({"state": "Offered", "uid": "x"}, 1),
        ({"state": "Taken", "uid": "the-first"}, 2),
    ):  # fmt: skip
        job = running()
        job["status"] |= {"pool": pool, "attempt": attempt}
        state = JobState.of(job)
        executor_logs(Asked({("e-2", "stack"): LOG}), state, "stack", 1, "a-1", "ros1")
        assert "pods_of" not in state.as_json()
    assert asked == [STATE.uid, "the-first", STATE.uid, STATE.uid]


def test_every_image_of_the_variants_is_searched() -> None:
    pods = FakePods({("e-1", "agent"): LOG, ("e-1", "stack"): "", ("e-1", "stack-1"): LOG})
    (part,) = executor_logs(pods, STATE, "stack", 9, "a-1", "ros1")
    assert part.source == "pod e-1, container stack-1"


def test_spark_s_log_of_a_case_is_that_of_its_executor() -> None:
    pods = FakePods(
        {
            ("e-1", "stack"): "", ("e-1", "spark"): "not this",
            ("e-2", "stack"): LOG, ("e-2", "spark"): "one\ntwo",
        }
    )  # fmt: skip
    (part,) = executor_logs(pods, STATE, "executor", 1, "a-1", "ros1")
    assert (part.source, part.lines) == ("pod e-2, container spark", ["two"])
    assert len(executor_logs(pods, STATE, "executor", 9, None, "ros1")) == 2


@pytest.mark.parametrize(
    ("pods", "state", "sentence"),
    [
        (FakePods({}), JobState.of(ended()), "went with the end of the job"),
        (FakePods({}), JobState.of(a_job()), "the job has no executors yet: The operator"),
        (FakePods({("e-1", "stack"): ""}), STATE, "1 of 1 executors have none of case a-7"),
        (FakePods({}, ClusterError("you may not list pods")), STATE, "you may not list pods"),
    ],
)
def test_why_there_are_no_lines(pods: FakePods, state: JobState, sentence: str) -> None:
    (part,) = executor_logs(pods, state, "stack", 9, "a-7", "ros1")
    assert part.lines == []
    assert sentence in part.missing


def test_the_driver_s_log() -> None:
    pods = FakePods({("nightly-1-driver", "driver"): "planned\ncase a-1 failed\nended"})
    assert driver_log(pods, STATE, 2, None).lines == ["case a-1 failed", "ended"]
    assert driver_log(pods, STATE, 9, "a-1").lines == ["case a-1 failed"]
    assert "no line of the last 20,000 names a-7" in driver_log(pods, STATE, 9, "a-7").missing
    assert "there is no log of pod" in driver_log(FakePods({}), STATE, 9, None).missing
    assert "the job has no driver" in driver_log(pods, JobState.of(a_job()), 9, None).missing


@pytest.mark.parametrize("case", ["a-0003-s1", "a-0003-s10", "a-0003", "b.a-0003-s1", "a+b-0"])
def test_of_the_driver_s_log_a_case_has_the_lines_that_name_it_whole(case: str) -> None:
    names = ["a-0003-s1", "a-0003-s10", "a-0003", "b.a-0003-s1", "a+b-0", "aab-0"]
    log = "\n".join(f"case {name}: passed; then {name}." for name in names)
    (line,) = driver_log(FakePods({("nightly-1-driver", "driver"): log}), STATE, 9, case).lines
    assert line == f"case {case}: passed; then {case}."


def test_the_driver_s_log_says_how_each_case_ended(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    errored = make_row("a-10", "errored", "StackExited", attempts=2, seconds=12.34)
    with RowFile(tmp_path / "rows") as rows:
        journal = Journal(Storage({}), "file:///nowhere", 1)
        keeper = Keeper(Progress("file:///nowhere"), rows, journal)
        keeper.take([make_row("a-1", seconds=3.0), errored, errored, unplanned_row(UNPLANNED)])
    pods = FakePods({("nightly-1-driver", "driver"): "\n".join(caplog.messages)})
    assert driver_log(pods, STATE, 9, "a-1").lines == ["case a-1: passed, attempts 1, seconds 3.0"]
    assert driver_log(pods, STATE, 9, "a-10").lines == [
        "case a-10: errored StackExited, attempts 2, seconds 12.3"
    ]
    assert driver_log(pods, STATE, 9, "cut").lines == [
        "case cut: errored BagCut, attempts 0, seconds 0.0"
    ]
