"""The operator's bench: what it works out of moments, and what its fakes say."""

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from embedded import builds
from prometheus_client import generate_latest

from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.queue import WorkQueue
from tests.bench import operator_bench, operator_load, operator_peer, rows, run
from tests.bench.operator_api import MOST_TRIES, Client, Object
from tests.bench.operator_drivers import FakeDrivers, address, fault_after
from tests.bench.operator_load import ended_status, job, metric, pod_of
from tests.bench.operator_seen import Seen
from tests.bench.operator_times import delays, percentile, rate, staleness
from tests.unit.operator.builders import make_driver, make_job


def test_a_percentile_is_one_of_the_values() -> None:
    values = [float(n) for n in range(100, 0, -1)]
    assert percentile(values, 0.99) == 99.0
    assert percentile(values, 0.5) == 50.0
    assert percentile(values, 1.0) == 100.0
    assert percentile([7.0], 0.01) == 7.0
    with pytest.raises(ValueError, match="did anything happen"):
        percentile([], 0.99)


def test_a_delay_needs_its_end_and_is_never_negative() -> None:
    assert delays({"a": 1.0, "b": 2.0}, {"a": 1.5, "b": 1.9, "c": 9.0}) == [0.5, 0.0]
    with pytest.raises(ValueError, match="1 of 2 never got there, first b"):
        delays({"a": 1.0, "b": 2.0}, {"a": 1.5})


def test_a_rate_counts_from_the_first_begin_to_the_last_end() -> None:
    assert rate([10.0, 11.0], [12.0, 15.0]) == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("reported", "now", "expected"),
    [
        (None, 13.0, 3.0),  # the driver has run for 3 s, and nothing is reported
        (0, 10.9, 0.0),  # the count is still 0
        (0, 12.5, 1.5),  # it became 1 at 11.0
        (2, 12.5, 0.0),
        (2, 15.0, 2.0),  # it became 3 at 13.0
    ],
)
def test_a_status_is_stale_from_the_first_change_it_does_not_show(
    reported: int | None, now: float, expected: float
) -> None:
    assert staleness(now, 10.0, reported, 1.0) == pytest.approx(expected)


def test_fake_drivers_answer_by_address(monkeypatch: pytest.MonkeyPatch) -> None:
    assert (address(1), address(300)) == ("127.64.0.1", "127.64.1.44")
    drivers = FakeDrivers()
    drivers.running_since[address(2)] = 100.0
    monkeypatch.setattr("time.monotonic", lambda: 107.9)
    head, body = drivers.account(address(2)).split(b"\r\n\r\n")
    assert f"Content-Length: {len(body)}".encode() in head
    assert json.loads(body)["cases"]["passed"] == 7
    assert json.loads(drivers.account(address(1)).split(b"\r\n\r\n")[1])["cases"]["passed"] == 0


def test_each_fake_driver_has_one_fault_at_a_time_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    times = [fault_after(address(number)) for number in range(1, 101)]
    assert (min(times) >= 5, max(times) <= 25, len(set(times))) == (True, True, 100)
    assert sorted(times)[50] == pytest.approx(15, abs=0.5)  # spread evenly
    drivers, stated = FakeDrivers(), []
    drivers.running_since[address(1)] = 100.0
    for now in (99.9 + times[0], 100.1 + times[0]):
        monkeypatch.setattr("time.monotonic", lambda now=now: now)
        _, body = drivers.account(address(1)).split(b"\r\n\r\n")
        stated.append(json.loads(body)["cases"]["failed"])
    assert stated == [0, 1]


def test_the_bench_sees_when_a_fault_is_in_the_status(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([10.0, 20.0, 21.0, 22.0])
    monkeypatch.setattr("time.monotonic", lambda: next(clock))
    seen = Seen(FakeDrivers())
    running = {"status": {"phase": "Running", "podIP": address(1)}}
    seen.take_pod("ADDED", pod_of("one", "uid", 0) | running)
    assert seen.faulted == {"one": 10.0 + fault_after(address(1))}
    for failed in (0, 1, 2):
        status = {"phase": "Running", "cases": {"passed": 3, "failed": failed}}
        seen.take_job("MODIFIED", job("one") | {"status": status})
    assert seen.fault_reported == {"one": 21.0}


async def test_a_burst_has_rows_for_what_waits_and_for_what_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def found(_count: int) -> operator_load.Burst:
        return operator_load.Burst([20.0, 30.0], [1.0, 2.0], [3.0, 4.0], [4.5, 6.0], 11.0)

    monkeypatch.setattr(operator_load, "burst", found)
    rows = await operator_bench._burst(1.0, 1)
    assert [(row.metric, row.ours, row.missed) for row in rows] == [
        ("driver's pod to Accepted, p50", [1.0], False),
        ("driver's pod to Accepted, p99", [2.0], False),
        ("driver runs to status says so, p50", [3.0], False),
        ("driver runs to status says so, p99", [4.0], False),
        ("first fault to status says so, p50", [4.5], False),
        ("first fault to status says so, p99", [6.0], True),
        ("age of counts, p50", [20.0], False),
        ("age of counts, p99", [30.0], False),
        ("driver pods", [11.0], False),
    ]


def test_what_was_seen_first_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([1.0, 2.0, 3.0, 4.0])
    monkeypatch.setattr("time.monotonic", lambda: next(clock))
    seen = Seen(FakeDrivers())
    pod = pod_of("one", "uid", 0)
    seen.take_pod("ADDED", pod)
    running = pod | {"status": {"phase": "Running", "podIP": "127.64.0.1"}}
    seen.take_pod("MODIFIED", running)
    seen.take_pod("MODIFIED", running)
    seen.take_pod("ADDED", pod_of("one", "uid", 1))  # an executor
    assert (seen.pod_created, seen.pod_running) == ({"one": 1.0}, {"one": 2.0})
    assert seen.drivers.running_since == {"127.64.0.1": 2.0}
    seen.take_job("MODIFIED", job("one") | {"status": ended_status("one")})
    assert (seen.accepted, seen.running_reported, seen.passed) == (
        {"one": 4.0}, {"one": 4.0}, {"one": 96},
    )  # fmt: skip


async def test_a_peer_that_does_not_run_leaves_its_side_empty(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async def ours(_count: int) -> tuple[float, float]:
        return 20.0, 1.0

    async def theirs(_count: int) -> tuple[float, float]:
        raise TimeoutError("no Java")

    monkeypatch.setattr(operator_load, "creation_rate", ours)
    monkeypatch.setattr(operator_peer, "seconds_to_pods", theirs)
    (row,) = await operator_bench._beside_the_peer(1.0, 3)
    assert (row.ours, row.theirs, row.missed) == ([1.0, 1.0, 1.0], [], False)
    assert "left out: kubeflow/spark-operator v2.3.0: no Java" in capsys.readouterr().err


async def test_a_watch_goes_on_where_it_was_and_reports_why_it_broke(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def at_once(_seconds: float) -> None:
        pass

    monkeypatch.setattr(asyncio, "sleep", at_once)
    seen: list[str] = []
    asked: list[str] = []

    class Interrupted(Client):
        async def _watch_once(
            self, _path: str, take: Callable[[str, Object], None], version: str
        ) -> tuple[str, str]:
            asked.append(version)
            take("ADDED", {"metadata": {"name": version}})
            return ("7", "") if len(asked) == 1 else ("7", "storage is (re)initializing")

    with pytest.raises(RuntimeError, match="storage is"):
        nobody: Any = None
        take = lambda _, pod: seen.append(pod["metadata"]["name"])  # noqa: E731
        await Interrupted(nobody, "").watch("/pods", take)
    assert asked[:3] == ["0", "7", "0"]
    assert len(asked) == MOST_TRIES + 1
    assert seen == asked


def test_metrics_are_read_by_the_start_of_their_lines() -> None:
    text = (
        '# HELP bagpipe_jobs\nbagpipe_jobs{phase="Running"} 5.0\nbagpipe_jobs{phase="Failed"} 2\n'
    )
    assert sum(metric(text, "bagpipe_jobs{")) == 7.0


def test_what_the_bench_waits_for_is_counted_by_the_operator_and_nothing_else_is() -> None:
    view, queue = View(), WorkQueue()
    metrics = JobMetrics(view, queue)
    for number in range(3):
        view.put_job(make_job(f"job-{number}").view())
        view.put_pod(PodView.from_object(make_driver(f"job-{number}").object()))
        metrics.reconciled(f"uid-of-job-{number}")
    # The first that ended: its counter's name begins like the one of the jobs that are there.
    ended = make_job("job-0").with_status(**ended_status("job-0")).view()
    metrics.job_written(make_job("job-0").view(), ended)
    text = generate_latest(metrics.registry).decode()
    assert sum(metric(text, "bagpipe_jobs{")) == 3.0
    assert sum(metric(text, "bagpipe_pods{")) == 3.0
    assert sum(metric(text, 'bagpipe_reconciles_total{result="done"}')) == 3.0


def test_the_loads_jobs_need_no_volume() -> None:
    assert "pvc://" not in json.dumps(job("any"))


def test_objects_that_are_left_miss_their_promise() -> None:
    assert not operator_bench.promised("1", "left", "objects", 0.0, 0.0).missed
    assert operator_bench.promised("1", "left", "objects", 1.0, 0.0).missed
    assert operator_bench.promised("1", "cold start", "s", 15.1, 15.0).missed
    assert operator_bench.promised("1", "driver pods", "jobs/s", 9.9, 10.0).missed
    assert "5.000 s" in rows.table([operator_bench.promised("1", "age", "s", 4.0, 5.0)])


def test_the_sizes_are_those_that_are_promised() -> None:
    assert (operator_load.BURST, operator_load.CYCLES) == (1000, 1000)
    assert operator_load.RUNNING * operator_load.PODS_PER_JOB == 5000
    assert operator_load.FINISHED == 5000
    assert operator_load.PER_SECOND * operator_load.STEADY_SECONDS == 300


def test_the_bench_is_called_by_its_name_and_not_by_its_parts() -> None:
    found = run.benches()
    assert "operator" in found
    assert [name for name in found if name.startswith("operator_")] == []


def test_the_versions_reported_are_those_that_are_built() -> None:
    modules = Path(__file__).parents[2] / "cluster"
    kwok = (modules / "kwok/go.mod").read_text()
    assert f"sigs.k8s.io/kwok {operator_bench.KWOK_VERSION} " in kwok
    peer = (modules / "spark-operator/go.mod").read_text()
    assert f"github.com/kubeflow/spark-operator/v2 {operator_peer.VERSION} " in peer
    assert builds.KWOK.package.startswith("sigs.k8s.io/kwok/")


def test_loads_are_chosen_by_name() -> None:
    assert operator_bench.chosen("") == [
        "peer",
        "rate",
        "steady",
        "burst",
        "full",
        "cycles",
        "largest",
    ]
    assert operator_bench.chosen(" full, burst ") == ["full", "burst"]
    with pytest.raises(SystemExit, match=r"BENCH_LOADS names fast; there are: peer,rate,steady,"):
        operator_bench.chosen("fast,full")


def test_a_load_that_fails_costs_the_others_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    made = [operator_bench.promised("5", "age", "s", 4.0, 5.0)]

    async def works(_scale: float, _rounds: int) -> list[rows.Row]:
        return made

    async def fails(_scale: float, _rounds: int) -> list[rows.Row]:
        # What was printed before this load began is there, whatever becomes of it.
        assert "| 5 | age | 4.000 s |" in capsys.readouterr().out
        raise TimeoutError("not within 120 s")

    monkeypatch.setattr(operator_bench, "LOADS", {"one": works, "two": fails, "three": works})
    monkeypatch.setattr(rows, "RESULTS", tmp_path)
    monkeypatch.setattr(run, "ROOT", tmp_path)
    monkeypatch.setenv("BENCH_LOADS", "one,two,three")
    monkeypatch.delenv("BENCH_SCALE", raising=False)
    assert run.main(["operator"]) == 1
    output = capsys.readouterr().out
    assert output.count("two gave no rows: TimeoutError: not within 120 s") == 2
    assert output.endswith("not within 120 s\n")
    kept = json.loads((tmp_path / "operator.json").read_text())
    assert [row["ours"] for row in kept["rows"]] == [[4.0]]


def test_a_smaller_run_is_not_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    async def works(scale: float, _rounds: int) -> list[rows.Row]:
        return [operator_bench.promised(f"{scale:g}", "age", "s", 6.0, 5.0)]

    monkeypatch.setattr(operator_bench, "LOADS", {"one": works})
    monkeypatch.setattr(rows, "RESULTS", tmp_path)
    monkeypatch.setenv("BENCH_SCALE", "0.1")
    assert run.main(["operator"]) == 0
    assert run.main(["operator", "--gate"]) == 1
    assert list(tmp_path.iterdir()) == []
