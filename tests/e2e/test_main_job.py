"""The example's job, as a newcomer applies it: every message counted, real bags left behind."""

import itertools
import posixpath
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml

from tests.e2e import jobs
from tests.e2e import kubectl as k
from tests.recording import MESSAGES

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("recordings")]


def recorded_topics(namespace: str, path: str) -> dict[str, int]:
    """Messages per topic, as Debian's rosbag counts them."""
    info = yaml.safe_load(k.in_toolbox(namespace, "rosbag", "info", "--yaml", path))
    return {topic["topic"]: topic["messages"] for topic in info["topics"]}


def test_the_examples_job_is_complete_and_lossless(namespace: str, tmp_path: Path) -> None:
    watched = tmp_path / "watched"
    with (
        jobs.applied(namespace, jobs.patient(jobs.example())) as name,
        watching_graces(namespace, watched),
    ):
        _check_the_examples_job(namespace, _ended_on_two_executors(namespace, name))

        def both_deleted() -> bool:
            return len(first_graces(watched)) == 2 and all(first_graces(watched))

        k.await_that("both executors to be seen deleted", both_deleted, 120)
    jobs.await_none_left(namespace)
    # Not the ten minutes of a case that ends: there is none any more.
    assert first_graces(watched) == [{"10"}] * 2


def first_graces(watched: Path) -> list[set[str]]:
    """Of each of the first two executors, the grace periods, in seconds, with which it was deleted.

    Without those of 0, by which a kubelet lets go of what has ended.
    """
    graces: dict[str, set[str]] = {}
    # A line that kubectl is writing has no end yet.
    for name, *grace in map(str.split, watched.read_text().rpartition("\n")[0].splitlines()):
        graces.setdefault(name, set()).update(grace)
    first = (each for name, each in graces.items() if name.endswith(("-exec-1", "-exec-2")))
    return [each - {"0"} for each in first]


@contextmanager
def watching_graces(namespace: str, watched: Path) -> Iterator[None]:
    """While the block lasts, a line in that file for each change of an executor's pod."""
    line = '{.metadata.name} {.metadata.deletionGracePeriodSeconds}{"\\n"}'
    watch = [
        *("kubectl", "-n", namespace, "get", "pods", "-l", "sim.bagpipe.io/role=executor"),
        *("--watch", "-o", f"jsonpath={line}"),
    ]
    with (
        watched.open("w") as seen,
        subprocess.Popen(watch, stdout=seen, env=k.tool_environment()) as process,
    ):
        try:
            yield
        finally:
            process.terminate()
            process.wait(60)


def _ended_on_two_executors(namespace: str, name: str) -> k.Object:
    def both_executors() -> list[k.Object] | None:
        pods = k.items(namespace, "pods", "-l", "sim.bagpipe.io/role=executor")
        return pods if len(pods) == 2 else None

    executors = k.await_that("both executors", both_executors, 240)
    for pod in executors:
        assert [c["name"] for c in pod["spec"]["initContainers"]] == ["agent", "stack"]
        assert pod["spec"]["automountServiceAccountToken"] is False
    return jobs.ended(namespace, name, 600)


def _check_the_examples_job(namespace: str, job: k.Object) -> None:
    name, status = job["metadata"]["name"], job["status"]
    assert status["verdict"] == "Passed", jobs.account(namespace, job)
    waited = ("wait", "--for=condition=Passed", f"simjob/{name}", "--timeout=0s")
    assert "condition met" in k.kubectl("-n", namespace, *waited)
    assert (status["cases"]["planned"], status["cases"]["passed"]) == (4, 4)
    assert (status["cases"]["failed"], status["cases"]["errored"]) == (0, 0)
    assert status["ledger"]["sent"] == status["ledger"]["received"] == MESSAGES
    assert status["ledger"]["dropped"] == 0
    assert status["observedGeneration"] == job["metadata"]["generation"]
    assert status["startTime"] < status["completionTime"]

    manifest, rows = k.results(namespace, status["results"])
    assert manifest["ledger"]["sent"] == MESSAGES
    assert [row["outcome"] for row in rows] == ["passed"] * 4
    windows = [row["window"] for row in rows]
    for before, after in itertools.pairwise(windows):
        assert before[2] == after[1]
    folder = "/" + status["results"].removeprefix("pvc://")
    for row in rows:
        topics = recorded_topics(namespace, posixpath.join(folder, row["recorded"]))
        counted = {t["topic"]: t["messages"] for t in row["result"]["recorded"]["topics"]}
        assert topics == counted == {"/tf": row["result"]["ledger"]["sent"]}
        assert row["attempts"] == 1

    table = k.kubectl("-n", namespace, "get", "simjob", name)
    assert table.splitlines()[0].split()[:5] == ["NAME", "VERDICT", "PHASE", "CASES", "PASSED"]
    assert table.splitlines()[1].split()[:4] == [name, "Passed", "Complete", "4"]


def test_deleting_a_running_job_leaves_nothing_behind(namespace: str) -> None:
    job = jobs.make_job("deleted-midway", playback={"mode": "realtime", "rate": 0.2})
    with jobs.applied(namespace, job) as name:

        def running() -> bool:
            status = k.get(namespace, "simjob", name).get("status", {})
            return bool(status.get("cases", {}).get("running", 0) == 1)

        k.await_that("its case to run", running, 300)
    jobs.await_none_left(namespace)
