"""What the bench of a job's start takes from objects, logs and what its node published."""

from typing import Any

import pytest

from tests.bench.start import ORDER, Case, case_to_case, rows
from tests.bench.start_seen import Moments, of_job, of_log, of_pod


def pod(name: str, node: str = "", **states: tuple[str, bool]) -> dict[str, Any]:
    statuses = [{"name": each, "state": {state: {}}, "started": started}
                for each, (state, started) in states.items()]  # fmt: skip
    return {"metadata": {"name": name}, "spec": {"nodeName": node},
            "status": {"containerStatuses": statuses}}  # fmt: skip


def test_an_earlier_moment_stays() -> None:
    moments = Moments()
    for moment in (2.0, 1.0, 3.0):
        moments.note("planned", moment)
    assert moments == {"planned": 1.0}


def test_pods_show_how_far_they_are() -> None:
    assert list(of_pod(pod("a-1-driver"))) == ["driver created"]
    assert list(of_pod(pod("a-1-driver", "n", driver=("running", True)))) == [
        "driver created", "driver scheduled", "driver's containers run",
    ]  # fmt: skip
    begun = pod("a-1-exec-1", "n", spark=("running", True), stack=("running", False))
    assert list(of_pod(begun))[-1] == "executor's containers run"
    begun["status"]["initContainerStatuses"] = [
        {"name": "agent", "state": {"terminated": {}}, "started": False},
        {"name": "stack", "state": {"running": {}}, "started": True},
    ]
    assert list(of_pod(begun))[-3:] == ["agent copied", "stack's container runs", "agent ready"]
    waits = pod("a-1-exec-1", "n", spark=("waiting", False), stack=("running", True))
    assert list(of_pod(waits)) == ["executor created", "executor scheduled"]


def test_a_job_shows_its_conditions() -> None:
    conditions = [{"type": "Accepted", "status": "True"}, {"type": "Planned", "status": "False"}]
    assert list(of_job({"status": {"conditions": conditions}})) == ["Accepted"]
    assert list(of_job({})) == []


def test_lines_of_a_log_have_the_runtime_s_moments() -> None:
    text = (
        "2026-11-24T04:25:28.647863225Z 2026-11-24 04:25:28,647 bagpipe.driver 4 cases planned, 0\n"
        "2026-11-24T04:25:29.5Z something else\n"
        "2026-11-24T04:25:30.000000999Z 04:25:30,000 bagpipe.driver Spark settings: {}\n"
    )
    assert dict(of_log(text)) == {
        "planned": pytest.approx(1795494328.647863), "Spark's JVM asked for": 1795494330.0,
    }  # fmt: skip


def test_from_case_to_case_the_nodes_own_time_does_not_count() -> None:
    def case(begun: float) -> Case:
        first = {"begun": begun, "registered": begun + 0.5, "received": begun + 0.6}
        return [first, first | {"received": begun + 1.0}], 0.25

    changes = list(case_to_case([case(10.0), case(11.4), case(12.6)]))
    assert changes == [pytest.approx((1.0, 0.75)), pytest.approx((0.8, 0.75))]
    pooled = [{"first message": 2.5}]
    made = rows([{"Accepted": 0.1, "first message": 7.5}], pooled, changes)
    assert {"Accepted", "first message"} <= set(ORDER)
    assert [row.metric for row in made] == [
        "Accepted", "first message", "first message", "of the nodes themselves", "beyond the nodes",
    ]  # fmt: skip
    in_pool = made.pop(2)
    assert (in_pool.case, in_pool.theirs, in_pool.missed) == ("apply, in a pool", [2.0], True)
    shown = {row.metric: row for row in made}
    assert shown["Accepted"].ours == [0.1]
    assert (shown["first message"].theirs, shown["first message"].missed) == ([8.0], False)
    assert not shown["beyond the nodes"].missed
    assert {row.metric for row in rows([], [], [(1.0, 0.5)]) if row.missed} == {"beyond the nodes"}
