"""The example's job, as a newcomer applies it: every message counted, real bags left behind."""

import itertools
import posixpath
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml

from tests import waiting
from tests.e2e import jobs
from tests.e2e import kubectl as k
from tests.recording import MESSAGES

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("recordings")]


def recorded_topics(namespace: str, path: str) -> dict[str, int]:
    """Messages per topic, as Debian's rosbag counts them."""
    info = yaml.safe_load(k.in_toolbox(namespace, "rosbag", "info", "--yaml", path))
    return {topic["topic"]: topic["messages"] for topic in info["topics"]}


# Promise: executors-have-10-s
def test_the_examples_job_is_complete_and_lossless(namespace: str, tmp_path: Path) -> None:
    watched = tmp_path / "watched"
    with watching_removal(namespace, watched):
        with jobs.applied(namespace, jobs.patient(jobs.example())) as name:
            _check_the_examples_job(namespace, _ended_on_two_executors(namespace, name))
            waiting.wait_until(
                lambda: all(each.had_seconds() for each in first_two(watched)),
                120,
                lambda: f"an executor was not deleted with 10 s:\n{watched.read_text()}",
            )
        jobs.await_none_left(namespace)
    late = [each for each in first_two(watched) if not each.had_seconds()]
    assert not late, watched.read_text()


@dataclass
class Removal:
    """What a watch has seen of an executor: its node, its phase and how long it had to end."""

    node: str = ""
    phase: str = ""
    graces: set[str] = field(default_factory=set)

    def had_seconds(self) -> bool:
        """Whether it was deleted with 10 s, or nothing of it ran when it was.

        An API server gives no time to a pod that has ended or was never scheduled, and a kubelet
        lets go of each other one with 0 s in the end.
        """
        if self.phase in ("Succeeded", "Failed") and self.graces <= {"0"}:
            return True
        if not self.node:
            return self.graces == {"0"}
        return self.graces - {"0"} == {"10"}


def first_two(watched: Path) -> list[Removal]:
    """The first two executors, of which nothing is known that a watch has not seen."""
    first, second = Removal(), Removal()
    # A line that kubectl is writing has no end yet.
    for line in watched.read_text().rpartition("\n")[0].splitlines():
        name, node, phase, grace = line.split("|")
        if name.endswith(("-exec-1", "-exec-2")):
            executor = first if name.endswith("-exec-1") else second
            executor.node, executor.phase = node, phase
            executor.graces |= {grace} - {""}
    return [first, second]


@contextmanager
def watching_removal(namespace: str, watched: Path) -> Iterator[None]:
    """While the block lasts, a line in that file for each change of an executor's pod."""
    fields = ".metadata.name .spec.nodeName .status.phase .metadata.deletionGracePeriodSeconds"
    line = "|".join(f"{{{each}}}" for each in fields.split()) + '{"\\n"}'
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
