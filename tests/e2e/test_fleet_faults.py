"""200 cases on three nodes, disturbed in every way: none lost, none twice, none run in vain.

`make test-nodes` runs it; it needs `make cluster NODES=3` with the operator installed.
"""

import os
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from embedded import faults

from tests.e2e import fleet, jobs, nodes
from tests.e2e import kubectl as k

pytestmark = pytest.mark.nodes


@pytest.fixture(scope="module", autouse=True)
def files(namespace: str) -> Iterator[None]:
    """The inputs on the claim, which all three nodes have."""
    if os.geteuid() or len(nodes.names()) != 3:
        pytest.skip("needs root and `make cluster NODES=3`")
    fleet.put_files(namespace)
    yield
    faults.join_all()


def await_done(namespace: str, job: str, least: int, seconds: float = 150) -> int:
    """Wait until so many cases have passed."""

    def look() -> int | None:
        status = k.get(namespace, "simjob", job).get("status", {})
        passed: int = status.get("cases", {}).get("passed", 0)
        return passed if passed >= least else None

    return k.await_that(f"{least} cases of {job} to pass", look, seconds)


def assert_undisturbed(namespace: str, job: k.Object, folder: Path | None = None) -> dict[str, str]:
    """The job's result is that of a job to which nothing happened; gives case -> recorded name.

    It is looked for on the claim `results`, or in `folder`.
    """
    status = job["status"]
    assert (status["phase"], status["verdict"]) == ("Complete", "Passed"), status
    assert status["cases"]["passed"] == status["cases"]["planned"] == fleet.CASES
    left = fleet.left_in(folder) if folder else fleet.left_on_claim(namespace, status["results"])
    assert sorted(row["case"] for row in left.rows) == sorted(fleet.expected())
    entries = left.manifest["cases"]
    assert [entry["outcome"] for entry in entries] == ["passed"] * fleet.CASES
    recorded = {entry["case"]: entry["recorded"][0] for entry in entries}
    contents = {case: left.kept[name.split("/")[1]] for case, name in recorded.items()}
    assert contents == fleet.expected()
    assert len(left.kept) == fleet.CASES, "files that the manifest does not name were left behind"
    assert left.journal == []
    return recorded


def test_killed_executors_and_a_killed_sidecar(namespace: str) -> None:
    chance = random.Random(4)  # noqa: S311  any choice will do
    with jobs.applied(namespace, fleet.make_job("killed")) as name:
        for least in (20, 60, 100):
            await_done(namespace, name, least)
            victim = chance.choice(fleet.pods(namespace, name, "executor"))
            k.kubectl(
                "-n", namespace, "delete", "pod", victim["metadata"]["name"],
                "--grace-period=0", "--force", "--wait=false",
            )  # fmt: skip
        await_done(namespace, name, 120)
        pod = chance.choice(fleet.pods(namespace, name, "executor"))
        faults.kill_container(pod["spec"]["nodeName"], fleet.container_id(pod, "stack"))
        ended = jobs.ended(namespace, name, 240)
        assert_undisturbed(namespace, ended)
        assert ended["status"]["attempt"] == 1


def drain_of_executors(node: str) -> None:
    """As before a spot node goes, or its kernel is changed: its executors are evicted."""
    k.kubectl(
        "drain", node, "--pod-selector", "sim.bagpipe.io/role=executor",
        "--delete-emptydir-data", "--ignore-daemonsets", "--timeout=120s", seconds=150,
    )  # fmt: skip


def test_nodes_that_are_drained_in_turn_cost_no_case_a_start(namespace: str) -> None:
    width = jobs.spark(3, 4) | {"executors": {"min": 1, "max": 3}}
    with jobs.applied(namespace, fleet.make_job("drained", spark=width)) as name:
        evicted = 0
        for least, node in zip((20, 60, 100), nodes.names(), strict=True):
            await_done(namespace, name, least)
            there = fleet.pods(namespace, name, "executor")
            evicted += sum(pod["spec"]["nodeName"] == node for pod in there)
            try:
                drain_of_executors(node)
            finally:
                k.kubectl("uncordon", node)
        ended = jobs.ended(namespace, name, 240)
        assert_undisturbed(namespace, ended)
        assert evicted >= 3, "the executors were on other nodes each time"
        _, rows = k.results(namespace, ended["status"]["results"])
        assert {(row["starts"], row["attempts"]) for row in rows} == {(1, 1)}
        assert (ended["status"]["attempt"], ended["status"]["lostDrivers"]) == (1, 0)


def test_the_cases_of_a_frozen_executor_are_overtaken(namespace: str) -> None:
    # Longer than the minute after which a case may be called slow.
    job = fleet.make_job("frozen", playback={"caseTimeout": "150s"})
    with jobs.applied(namespace, job) as name:
        await_done(namespace, name, 20)
        pod = fleet.pods(namespace, name, "executor")[0]
        # All processes of the stack's container but its first: the agent's slots and the programs.
        freeze = "import os, signal; os.kill(-1, signal.SIGSTOP)"
        k.kubectl(
            "-n", namespace, "exec", pod["metadata"]["name"], "-c", "stack", "--",
            "python3", "-c", freeze,
        )  # fmt: skip
        ended = jobs.ended(namespace, name, 240)
        assert_undisturbed(namespace, ended)
        _, rows = k.results(namespace, ended["status"]["results"])
        copied = [row for row in rows if row["starts"] == 2]
        assert 1 <= len(copied) <= job["spec"]["spark"]["slots"]
        assert {row["starts"] for row in rows if row not in copied} == {1}
        assert ended["status"]["attempt"] == 1


def test_a_killed_driver_is_replaced_and_runs_nothing_again(namespace: str) -> None:
    with jobs.applied(namespace, fleet.make_job("orphaned")) as name:
        await_done(namespace, name, 60)
        status = k.get(namespace, "simjob", name)["status"]
        (driver,) = fleet.pods(namespace, name, "driver")
        done = fleet.journaled(namespace, status["results"])
        assert len(done) >= 20
        faults.kill_container(driver["spec"]["nodeName"], fleet.container_id(driver, "driver"))
        ended = jobs.ended(namespace, name, 240)
        recorded = assert_undisturbed(namespace, ended)
        assert ended["status"]["attempt"] == 2
        # What the journal had is what counts: no case of it was run again and counted instead.
        assert {case: recorded[case] for case in done} == done
        log = k.kubectl("-n", namespace, "logs", f"{name}-2-driver")
        before = int(log.split(" cases were done before")[0].split()[-1])
        assert before >= len(done)
        events = k.items(namespace, "events", "--field-selector", f"involvedObject.name={name}")
        assert [e["reason"] for e in events].count("DriverFailed") == 1


def test_a_node_that_is_cut_off(namespace: str) -> None:
    with jobs.applied(namespace, fleet.make_job("severed")) as name:
        await_done(namespace, name, 40)
        (driver,) = fleet.pods(namespace, name, "driver")
        toolbox = k.get(namespace, "pod", k.TOOLBOX)["spec"]["nodeName"]
        home = {driver["spec"]["nodeName"], toolbox, nodes.names()[0]}
        executors = {pod["spec"]["nodeName"] for pod in fleet.pods(namespace, name, "executor")}
        away = sorted(executors - home) or sorted(set(nodes.names()) - home)
        faults.cut_off(away[0])
        try:
            assert_undisturbed(namespace, jobs.ended(namespace, name, 360))
        finally:
            faults.join(away[0])
    k.await_that("the node to come back", lambda: nodes.ready(away[0]), 90)


def test_a_driver_whose_node_is_cut_off_is_replaced(namespace: str) -> None:
    toolbox = k.get(namespace, "pod", k.TOOLBOX)["spec"]["nodeName"]
    away = next(node for node in nodes.names()[1:] if node != toolbox)
    others = [node for node in nodes.names() if node != away]
    for node in others:
        k.kubectl("cordon", node)
    try:
        with jobs.applied(namespace, fleet.make_job("beheaded")) as name:
            k.await_that("a driver", lambda: fleet.pods(namespace, name, "driver"), 60)
            for node in others:
                k.kubectl("uncordon", node)
            await_done(namespace, name, 40)
            faults.cut_off(away)
            try:
                ended = jobs.ended(namespace, name, 360)
                assert_undisturbed(namespace, ended)
                assert ended["status"]["attempt"] == 2
            finally:
                faults.join(away)
            k.await_that("the node to come back", lambda: nodes.ready(away), 90)
    finally:
        for node in others:
            k.kubectl("uncordon", node)


def test_a_full_volume_is_waited_for(namespace: str) -> None:
    small = faults.SmallVolume("fleet-small", 16)
    small.create()
    try:
        nodes.apply(small.objects(namespace, "small"))
        job = fleet.make_job("crammed", output="pvc://small/out")
        with jobs.applied(namespace, job) as name:
            await_done(namespace, name, 40)
            small.fill()
            warned = k.await_that(
                "the job to say that its volume is full",
                lambda: "No space left" in json_of(namespace, name),
                60,
            )
            assert warned
            small.relieve()
            ended = jobs.ended(namespace, name, 240)
            folder = small.folder / "out" / name / ended["metadata"]["uid"]
            assert_undisturbed(namespace, ended, folder)
    finally:
        k.kubectl("-n", namespace, "delete", "pvc", "small", "--ignore-not-found")
        k.kubectl("delete", "persistentvolume", small.name, "--ignore-not-found")
        small.remove()


def json_of(namespace: str, job: str) -> str:
    """All that the status of a job says, as text."""
    return str(k.get(namespace, "simjob", job).get("status", {}))
