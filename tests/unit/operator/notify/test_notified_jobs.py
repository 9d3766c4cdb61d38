"""The ends of jobs and who is told: over restarts, replicas, lost writes and what others write."""

import asyncio
import json
from typing import Any

import pytest
from prometheus_client import CollectorRegistry

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.announcer import Announcer, event_of
from bagpipe_operator.jobs.policies.notifying import kind_of, kinds_of
from bagpipe_operator.jobs.view import JobView, View
from bagpipe_operator.notify.courier import Courier, Line
from bagpipe_operator.notify.letter import Answer, Letter
from bagpipe_operator.notify.metrics import NotificationMetrics
from bagpipe_operator.receivers import Receiver, Receivers
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import Clock, JobBuilder, account, make_driver, make_job
from tests.unit.operator.fakes import FakeApi, FakeDrivers
from tests.unit.operator.world import UID, World

TEAM = Receiver("team", "http://127.0.0.1/")
RED = Receiver("red", "http://127.0.0.1/", frozenset({"failed", "regressed"}))
MAPS = Receiver("maps", "http://127.0.0.1/", namespaces=frozenset({"maps"}))
ALL_LANES = Receiver("all-lanes", "http://127.0.0.1/", always=frozenset({"lanes"}))
DONE: dict[str, Any] = {
    "reason": "AllCasesPassed",
    "message": "4 of 4 passed.",
    "verdict": "Passed",
}
WORSE = {"variant": "", "verdict": "worse", "regressed": 2, "fixed": 0, "flaky": 1}


class Told:
    """A World whose operator notifies receivers; they take what they get, or refuse it."""

    def __init__(self, *receivers: Receiver, job: JobBuilder | None = None) -> None:
        self.world = World(job or make_job("x").with_spec("notify", ["team"]))
        self.receivers = receivers or (TEAM,)
        self.got: list[Letter] = []
        self.answer = Answer(True)
        self.restart()

    async def post(self, letter: Letter) -> Answer:
        self.got.append(letter)
        return self.answer

    def restart(self, receivers: tuple[Receiver, ...] | None = None) -> None:
        """Another operator, which knows what the API server has of the job and nothing else."""
        self.receivers = self.receivers if receivers is None else receivers
        self.world.forget_everything()
        self.courier = Courier()
        metrics = NotificationMetrics([], CollectorRegistry())
        clock = self.world.clock
        self.lines = [
            Line(r.name, self, metrics, self.courier.ended, lambda: True, clock.monotonic)
            for r in self.receivers
        ]
        for line in self.lines:
            self.courier.add(line)
        self.world.reconciler.announcer = Announcer(Receivers(self.receivers), self.courier)

    async def end(self, **says: Any) -> None:
        """The job ends, as its driver says."""
        await self.world.reconcile()
        done = account("Complete", **(DONE | says))
        self.world.deliver(make_driver("x").ended(0, done))
        await self.world.reconcile(after=2)

    async def deliver(self) -> None:
        """All lines try what is due, and the job is looked at."""
        for line in self.lines:
            await line.deliver_due()
        await self.world.reconcile(after=1)

    def entries(self) -> list[Json]:
        found: list[Json] = self.world.status().get("notifications", [])
        return found

    def states(self) -> dict[str, str]:
        return {entry["receiver"]: entry["state"] for entry in self.entries()}


def has_notified(told: Told) -> bool:
    return any(c["type"] == "Notified" for c in told.world.status()["conditions"])


async def test_the_end_and_who_is_owed_are_one_write() -> None:
    told = Told()
    await told.world.reconcile()
    assert told.world.reason("Notified") == "Unknown/NotEnded"
    told.world.api.calls.clear()
    await told.end()
    assert told.world.api.calls.count("patch status") == 1
    assert told.entries() == [{"receiver": "team", "state": "Pending"}]
    assert told.world.reason("Notified") == "Unknown/Notifying"
    await told.deliver()
    assert told.entries() == [
        {"receiver": "team", "state": "Delivered", "time": "2026-11-20T04:00:03Z"}
    ]
    assert told.world.reason("Notified") == "True/Notified"
    assert [letter.identity for letter in told.got] == [f"{UID}-ended"]
    # Nothing is left to write or to send.
    told.world.api.calls.clear()
    for _ in range(3):
        await told.deliver()
    assert (told.world.api.calls, len(told.got)) == ([], 1)
    assert told.courier.outcomes(UID) == {}


async def test_an_operator_that_dies_before_it_sent_leaves_it_to_the_next() -> None:
    told = Told()
    await told.end()
    told.restart()
    await told.world.reconcile()
    await told.deliver()
    assert (len(told.got), told.states()) == (1, {"team": "Delivered"})


async def test_one_that_dies_before_it_wrote_what_it_sent_makes_it_two_alike() -> None:
    told = Told()
    await told.end()
    await told.lines[0].deliver_due()
    told.restart()
    await told.world.reconcile()
    await told.deliver()
    assert told.states() == {"team": "Delivered"}
    first, second = told.got
    assert (first.identity, first.body) == (second.identity, second.body)


async def test_a_status_that_can_t_be_written_sends_nothing_again() -> None:
    told = Told()
    await told.end()
    await told.lines[0].deliver_due()
    told.world.api.fail("patch status", ApiError(0, "Unreachable", "no answer"))
    with pytest.raises(ApiError):
        await told.world.reconcile()
    assert told.states() == {"team": "Pending"}
    await told.deliver()
    assert (len(told.got), told.states()) == (1, {"team": "Delivered"})


async def test_a_job_that_ended_before_the_upgrade_is_told_to_nobody() -> None:
    told = Told()
    told.restart(())
    await told.end()
    status = told.world.status()
    del status["notifications"]  # an earlier release wrote none
    status["conditions"] = [c for c in status["conditions"] if c["type"] != "Notified"]
    told.restart((TEAM, ALL_LANES))
    for _ in range(3):
        await told.deliver()
    assert (told.got, told.entries(), has_notified(told)) == ([], [], False)


async def test_a_restart_with_a_thousand_ended_jobs_sends_nothing_again() -> None:
    """Of ten it is owed: ten are sent, and no status but theirs is written."""
    sent: list[str] = []

    class Counting:
        async def post(self, letter: Letter) -> Answer:
            sent.append(letter.uid)
            return Answer(True)

    api, view, clock = FakeApi(version=900), View(), Clock()
    ended = Told()
    await ended.end()
    owed = json.dumps(ended.world.api.objects["jobs", "x"])
    await ended.deliver()
    settled = json.dumps(ended.world.api.objects["jobs", "x"])
    for number in range(1000):
        job: Json = json.loads(owed if number < 10 else settled)
        job["metadata"] |= {"name": f"j{number}", "uid": f"u{number}"}
        api.put("jobs", job)
        view.put_job(JobView.from_object(job))
    world = World()
    world.api, world.drivers, world.clock = api, FakeDrivers(), clock
    reconciler = world.restarted(view)
    courier = Courier()
    metrics = NotificationMetrics(["team"], CollectorRegistry())
    line = Line("team", Counting(), metrics, courier.ended, monotonic=clock.monotonic)
    courier.add(line)
    reconciler.announcer = Announcer(Receivers([TEAM]), courier)
    for _ in range(2):
        for number in range(1000):
            await reconciler.reconcile(f"u{number}")
        await line.deliver_due()
    assert sorted(sent) == sorted(f"u{number}" for number in range(10))
    assert api.calls.count("patch status") == 10


async def test_what_fails_is_said_in_the_status_and_by_an_event() -> None:
    told = Told()
    told.answer = Answer(False, "it answered 410", final=True)
    await told.end()
    await told.deliver()
    (entry,) = told.entries()
    assert entry["message"] == "In the last of 1 tries it answered 410."
    assert told.world.reason("Notified") == "False/NotificationLost"
    assert "team was not notified. In the last of 1 tries" in told.world.message("Notified")
    assert told.world.api.event_reasons().count("NotificationLost") == 1
    assert told.world.reason("Passed") == "True/Passed"


async def test_a_name_without_a_receiver_is_reported_at_once_and_the_job_runs_on() -> None:
    job = make_job("x").with_spec("notify", ["team", "teem", "maps"])
    told = Told(TEAM, MAPS, job=job)
    await told.world.reconcile()
    assert told.world.reason("Notified") == "False/ReceiverUnknown"
    assert told.world.message("Notified") == (
        "spec.notify has teem, maps, which are no receivers for jobs of this namespace: correct it,"
        " or let an administrator add it to the chart's notifications.receivers. The job runs on"
        " without."
    )
    assert told.world.api.event_reasons().count("ReceiverUnknown") == 1
    await told.end()
    await told.deliver()
    assert told.states() == {"team": "Delivered", "teem": "Unknown", "maps": "Unknown"}
    assert told.world.reason("Passed") == "True/Passed"
    assert told.world.api.event_reasons().count("ReceiverUnknown") == 1
    assert [letter.receiver for letter in told.got] == ["team"]


async def test_a_name_that_is_corrected_meanwhile_counts() -> None:
    told = Told(job=make_job("x").with_spec("notify", ["teem"]))
    await told.world.reconcile()
    job = told.world.api.objects["jobs", "x"]
    job["spec"]["notify"] = ["team"]
    job["metadata"] |= {"generation": 2, "resourceVersion": "900"}
    told.world.api.version = 900
    told.world.deliver_job()
    await told.end()
    await told.deliver()
    assert (told.states(), told.world.reason("Notified")) == (
        {"team": "Delivered"},
        "True/Notified",
    )


async def test_a_namespace_s_receiver_needs_no_name() -> None:
    told = Told(ALL_LANES, TEAM, job=make_job("x"))
    await told.end()
    await told.deliver()
    assert told.states() == {"all-lanes": "Delivered"}


async def test_a_job_of_which_nobody_is_told_has_no_word_of_it() -> None:
    told = Told(job=make_job("x"))
    await told.end()
    assert (has_notified(told), "notifications" in told.world.status()) == (False, False)


@pytest.mark.parametrize(
    ("says", "states"),
    [
        ({}, {}),
        ({"verdict": "Failed", "verdictReason": "Failed"}, {"red": "Pending"}),
        ({"comparisons": [WORSE]}, {"red": "Pending"}),
    ],
)
async def test_a_receiver_gets_what_it_asks_for(says: Json, states: dict[str, str]) -> None:
    told = Told(RED, job=make_job("x").with_spec("notify", ["red"]))
    await told.end(**says)
    assert told.states() == states
    reason = "Unknown/Notifying" if states else "True/Notified"
    assert told.world.reason("Notified") == reason


@pytest.mark.parametrize(
    ("status", "kinds"),
    [
        ({"phase": "Complete", "verdict": "Passed"}, {"passed"}),
        (
            {"phase": "Complete", "verdict": "Failed", "comparisons": [WORSE]},
            {"failed", "regressed"},
        ),
        ({"phase": "Complete", "verdict": "Invalid"}, {"invalid"}),
        ({"phase": "Complete"}, {"invalid"}),
        ({"phase": "Failed", "verdict": "Passed"}, {"errored"}),
        ({}, {"errored"}),
    ],
)
def test_how_a_job_ended(status: Json, kinds: set[str]) -> None:
    assert kinds_of(status) == kinds
    assert kind_of(status) in kinds


async def test_a_receiver_that_is_taken_away_is_waited_for_no_more() -> None:
    told = Told()
    await told.end()
    told.restart((MAPS,))
    await told.world.reconcile()
    assert told.states() == {"team": "Dropped"}
    assert "not among the operator's receivers any more" in told.world.message("Notified")


async def test_what_somebody_wrote_into_a_status_tells_nobody_else() -> None:
    """Who may write a status reaches no receiver that jobs of the namespace may not name."""
    told = Told(TEAM, MAPS, job=make_job("x"))
    forged = [{"receiver": "maps", "state": "Pending"}, {"receiver": 5}, "x", {"state": "Pending"}]
    told.world.api.objects["jobs", "x"]["status"] = {"notifications": forged}
    told.world.deliver_job()
    await told.end()
    assert "notifications" not in told.world.status()
    told.world.api.objects["jobs", "x"]["status"]["notifications"] = forged
    told.restart()
    for _ in range(2):
        await told.deliver()
    assert (told.got, told.states()) == ([], {"maps": "Dropped"})


async def test_a_job_is_not_removed_before_its_end_is_told() -> None:
    told = Told(job=make_job("x").with_spec("notify", ["team"]).with_spec("ttlAfterFinished", "0s"))
    await told.end()
    await told.world.reconcile(after=60)
    assert told.world.api.named("jobs") == ["x"]
    await told.deliver()
    assert (told.world.api.named("jobs"), len(told.got)) == ([], 1)


async def test_a_job_that_is_gone_leaves_nothing_behind() -> None:
    told = Told()
    await told.end()
    told.world.view.drop_job(UID)
    await told.lines[0].deliver_due()
    assert list(told.courier.outcomes(UID)) == ["team"]
    await told.world.reconcile()
    assert told.courier.outcomes(UID) == {}


async def test_a_receiver_that_hangs_delays_no_reconcile() -> None:
    told = Told()
    told.post = lambda _: asyncio.get_running_loop().create_future()  # type: ignore[method-assign,assignment,misc]
    (task,) = told.courier.tasks()
    await told.end()
    assert told.states() == {"team": "Pending"}
    told.world.api.calls.clear()
    await told.world.reconcile()
    assert told.world.api.calls == []
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def test_the_event_is_a_cloud_event_that_says_how_the_job_ended() -> None:
    job = make_job("x").with_spec("notify", ["team"])
    job.object["metadata"] |= {
        "labels": {"sim.bagpipe.io/schedule": "nightly"},
        "annotations": {"sim.bagpipe.io/commit": "0c1f", "example.com/token": "s3cr3t"},
    }
    told = Told(job=job)
    failure = {"case": "drive-1", "reason": "MessagesLost", "message": "7 messages were lost."}
    await told.end(
        verdict="Failed", verdictReason="Failed", failures=[failure], comparisons=[WORSE]
    )
    await told.deliver()
    (letter,) = told.got
    event = json.loads(letter.body)
    data = event.pop("data")
    assert event == {
        "specversion": "1.0",
        "id": f"{UID}-ended",
        "type": "io.bagpipe.sim.job.failed",
        "source": "/apis/sim.bagpipe.io/v1alpha1/namespaces/lanes/simulationjobs",
        "subject": "x",
        "time": "2026-11-20T04:00:02Z",
        "datacontenttype": "application/json",
    }
    assert data.pop("cases")["planned"] == 4
    assert data == {
        "namespace": "lanes", "name": "x", "uid": UID, "phase": "Complete", "verdict": "Failed",
        "reason": "Failed", "message": "4 of 4 passed.", "regressed": 2, "comparisons": [WORSE],
        "failures": [failure], "results": "pvc://results/lane/x",
        "startTime": "2026-11-20T04:00:00Z", "completionTime": "2026-11-20T04:00:02Z",
        "labels": {"sim.bagpipe.io/schedule": "nightly"},
        "annotations": {"sim.bagpipe.io/commit": "0c1f"},
    }  # fmt: skip
    told.restart()
    again = told.world.view.job(UID)
    assert again is not None
    assert event_of(again) == letter.body  # with the few marks that are kept


def test_an_event_is_bounded_whatever_a_status_holds() -> None:
    long = "x" * 100_000
    many = [{"case": long, "reason": long, "message": long, "variant": long}] * 1000
    job = make_job("x").with_status(
        phase="Complete", verdict=long, results=long, completionTime="2026-11-20T04:00:02Z",
        failures=many, comparisons=many, cases={f"c{n}": n for n in range(1000)},
        conditions=[
            {"type": "Complete", "status": "True", "reason": long, "message": long},
            {"type": "Passed", "status": "False", "reason": long, "message": long},
        ],
        notifications=[{"receiver": "team", "state": "Pending"}] * 100,
    )  # fmt: skip
    job.object["metadata"] |= {
        "labels": {f"l{n}": "v" * 63 for n in range(1000)},
        "annotations": {f"sim.bagpipe.io/a{n}": long for n in range(1000)},
    }
    body = event_of(job.view().kept())
    assert 10_000 < len(body) < 32_768
    assert len(job.view().status["notifications"]) == 32


def test_settings_of_old_have_no_receivers() -> None:
    assert Settings().receivers == ()
