"""What a row says of the starts of its case that Spark has lost."""

from typing import Any

import pytest
from py4j.protocol import Py4JNetworkError

from bagpipe.driver.lost_starts import Task, failed_tasks, given_up, with_evidence
from tests.unit.bagpipe.jobs import make_row


def task(index: int, attempt: int, executor: str, **changed: Any) -> Task:
    made: Task = {
        "index": index,
        "attempt": attempt,
        "executorId": executor,
        "host": f"10.0.0.{executor}",
        "duration": 2500,
        "errorMessage": f"ExecutorLostFailure (executor {executor} exited with exit code 137)",
    }
    return made | changed


def test_a_case_that_was_given_up_names_its_executors_and_why_they_were_lost() -> None:
    asked: list[int] = []

    def failed(stage: int) -> list[Task]:
        asked.append(stage)
        # As Spark reports them: the newest first, of all cases.
        return [task(1, 2, "7"), task(0, 0, "9"), task(1, 1, "6"), task(1, 0, "5", duration=None)]

    rows = [
        make_row("a"),
        given_up(make_row("b", "errored", "ExecutorLost"), 3, 1, 3),
        given_up(make_row("c", "errored", "ExecutorLost"), 3, 2, 4),
    ]
    passed, lost, unknown = with_evidence(rows, failed)
    assert passed == make_row("a")
    starts = lost["evidence"]["starts"]
    assert [(start["executor"], start["host"], start["seconds"]) for start in starts] == [
        ("5", "10.0.0.5", None), ("6", "10.0.0.6", 2.5), ("7", "10.0.0.7", 2.5),
    ]  # fmt: skip
    assert starts[0]["error"] == "ExecutorLostFailure (executor 5 exited with exit code 137)"
    assert unknown["evidence"] == {"starts": []}
    assert [row.get("taken_away") for row in (passed, lost, unknown)] == [None, 0, 0]
    assert [row for row in (lost, unknown) if "task" in row] == []
    assert asked == [3]


AWAY = "ExecutorLostFailure (executor 5 exited unrelated to the running tasks) Reason: deleted"
OWN = "ExecutorLostFailure (executor 5 exited caused by one of the running tasks) Reason: 137"


@pytest.mark.parametrize(
    ("errors", "taken_away"),
    [
        ([AWAY] * 4, 4),
        ([AWAY, OWN, AWAY, OWN], 2),
        ([OWN] * 4, 0),
        # Words of a user's own are not Spark's.
        ([f"Exception: {AWAY}", "", "exited unrelated to the running tasks"], 0),
        # Of more than are kept as evidence all are counted.
        ([AWAY] * 15, 15),
    ],
)
def test_starts_whose_executors_were_taken_away_are_not_those_that_were_lost(
    errors: list[str], taken_away: int
) -> None:
    tasks = [task(0, n, "5", errorMessage=error) for n, error in enumerate(errors)]
    (row,) = with_evidence([given_up(make_row("a"), 0, 0, len(tasks))], lambda _stage: tasks)
    assert row["taken_away"] == taken_away


@pytest.mark.parametrize(("launches", "not_its_fault"), [(3, 2), (4, 3), (2, 2)])
def test_a_start_that_runs_while_its_copy_gives_the_case_up_is_no_fault(
    launches: int, not_its_fault: int
) -> None:
    tasks = [task(0, 0, "5", errorMessage=AWAY), task(0, 1, "5", errorMessage=OWN)]
    tasks = tasks if launches > 2 else [tasks[0], tasks[0]]
    (row,) = with_evidence([given_up(make_row("a"), 0, 0, launches)], lambda _stage: tasks)
    assert row["taken_away"] == not_its_fault


def test_evidence_is_bounded() -> None:
    tasks = [task(0, n, "5", errorMessage="x" * 5000) for n in range(40)]
    (row,) = with_evidence([given_up(make_row("a"), 0, 0, len(tasks))], lambda _stage: tasks)
    starts = row["evidence"]["starts"]
    assert (len(starts), {len(start["error"]) for start in starts}) == (10, {1000})


def test_a_spark_that_does_not_say_why_costs_no_row() -> None:
    class Gone:
        @property
        def _jvm(self) -> object:
            raise Py4JNetworkError("Answer from Java side is empty")

    spark: Any = Gone()
    assert failed_tasks(spark, 0) == []
