"""Who is notified of jobs' ends: over restarts, lost writes, and what others write."""

import asyncio
import json
from typing import Any

import pytest
from prometheus_client import CollectorRegistry

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.announcer import Announcer, event_of
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.policies.notifying import kind_of, kinds_of
from bagpipe_operator.jobs.view import View
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


class Office:
    """A World whose operator notifies receivers; they take what they get, or refuse it."""

    def __init__(self, *receivers: Receiver, job: JobBuilder | None = None) -> None:
        self.world = World(job or make_job("x").with_spec("notify", ["team"]))
        self.receivers = receivers or (TEAM,)
        self.got: list[Letter] = []
        self.answer = Answer(True)
        self.hold: asyncio.Event | None = None
        self.asked = asyncio.Event()
        self.restart()

    async def post(self, letter: Letter) -> Answer:
        self.got.append(letter)
        self.asked.set()
        if self.hold is not None:
            await self.hold.wait()
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
        self.world.restart(announcer=Announcer(Receivers(self.receivers), self.courier))

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


def has_notified(office: Office) -> bool:
    return any(c["type"] == "Notified" for c in office.world.status()["conditions"])


async def test_the_end_and_who_is_owed_are_one_write() -> None:
    office = Office()
    await office.world.reconcile()
    assert office.world.reason("Notified") == "Unknown/NotEnded"
    office.world.api.calls.clear()
    await office.end()
    assert office.world.api.calls.count("patch status") == 1
    assert office.entries() == [{"receiver": "team", "state": "Pending"}]
    assert office.world.reason("Notified") == "Unknown/Notifying"
    await office.deliver()
    assert office.entries() == [
        {"receiver": "team", "state": "Delivered", "time": "2026-11-20T04:00:03Z"}
    ]
    assert office.world.reason("Notified") == "True/Notified"
    assert [letter.identity for letter in office.got] == [f"{UID}-ended"]
    # Nothing is left to write or to send.
    office.world.api.calls.clear()
    for _ in range(3):
        await office.deliver()
    assert (office.world.api.calls, len(office.got)) == ([], 1)
    assert office.courier.outcomes(UID) == {}


async def test_an_operator_that_dies_before_it_sent_leaves_it_to_the_next() -> None:
    office = Office()
    await office.end()
    office.restart()
    await office.world.reconcile()
    await office.deliver()
    assert (len(office.got), office.states()) == (1, {"team": "Delivered"})


async def test_one_that_dies_before_it_wrote_what_it_sent_makes_it_two_alike() -> None:
    office = Office()
    await office.end()
    await office.lines[0].deliver_due()
    office.restart()
    await office.world.reconcile()
    await office.deliver()
    assert office.states() == {"team": "Delivered"}
    first, second = office.got
    assert (first.identity, first.body) == (second.identity, second.body)


async def test_a_status_that_can_t_be_written_sends_nothing_again() -> None:
    office = Office()
    await office.end()
    await office.lines[0].deliver_due()
    office.world.api.fail("patch status", ApiError(0, "Unreachable", "no answer"))
    with pytest.raises(ApiError):
        await office.world.reconcile()
    assert office.states() == {"team": "Pending"}
    await office.deliver()
    assert (len(office.got), office.states()) == (1, {"team": "Delivered"})


async def test_a_job_that_ended_before_the_upgrade_is_reported_to_nobody() -> None:
    office = Office()
    office.restart(())
    await office.end()
    status = office.world.status()
    del status["notifications"]  # an earlier release wrote none
    status["conditions"] = [c for c in status["conditions"] if c["type"] != "Notified"]
    office.restart((TEAM, ALL_LANES))
    for _ in range(3):
        await office.deliver()
    assert (office.got, office.entries(), has_notified(office)) == ([], [], False)


async def test_a_restart_with_a_thousand_ended_jobs_sends_nothing_again() -> None:
    """Of ten it is owed: ten are sent, and no status but theirs is written."""
    sent: list[str] = []

    class Counting:
        async def post(self, letter: Letter) -> Answer:
            sent.append(letter.uid)
            return Answer(True)

    api, view, clock = FakeApi(version=900), View(), Clock()
    ended = Office()
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
    courier = Courier()
    metrics = NotificationMetrics(["team"], CollectorRegistry())
    line = Line("team", Counting(), metrics, courier.ended, monotonic=clock.monotonic)
    courier.add(line)
    reconciler = world.restarted(view, announcer=Announcer(Receivers([TEAM]), courier))
    for _ in range(2):
        for number in range(1000):
            await reconciler.reconcile(f"u{number}")
        await line.deliver_due()
    assert sorted(sent) == sorted(f"u{number}" for number in range(10))
    assert api.calls.count("patch status") == 10


async def test_what_fails_is_in_the_status_and_by_an_event() -> None:
    office = Office()
    office.answer = Answer(False, "it answered 410", final=True)
    await office.end()
    await office.deliver()
    (entry,) = office.entries()
    assert entry["message"] == "In the last of 1 tries it answered 410."
    assert office.world.reason("Notified") == "False/NotificationLost"
    assert "team was not notified. In the last of 1 tries" in office.world.message("Notified")
    assert office.world.api.event_reasons().count("NotificationLost") == 1
    assert office.world.reason("Passed") == "True/Passed"


async def test_a_name_without_a_receiver_is_reported_at_once_and_the_job_runs_on() -> None:
    job = make_job("x").with_spec("notify", ["team", "teem", "maps"])
    office = Office(TEAM, MAPS, job=job)
    await office.world.reconcile()
    assert office.world.reason("Notified") == "False/ReceiverUnknown"
    assert office.world.message("Notified") == (
        "spec.notify has teem, maps, which are no receivers for jobs of this namespace: correct it,"
        " or let an administrator add it to the chart's notifications.receivers. The job runs on"
        " without."
    )
    assert office.world.api.event_reasons().count("ReceiverUnknown") == 1
    await office.end()
    await office.deliver()
    assert office.states() == {"team": "Delivered", "teem": "Unknown", "maps": "Unknown"}
    assert office.world.reason("Passed") == "True/Passed"
    assert office.world.api.event_reasons().count("ReceiverUnknown") == 1
    assert [letter.receiver for letter in office.got] == ["team"]


async def test_a_name_that_is_corrected_meanwhile_counts() -> None:
    office = Office(job=make_job("x").with_spec("notify", ["teem"]))
    await office.world.reconcile()
    job = office.world.api.objects["jobs", "x"]
    job["spec"]["notify"] = ["team"]
    job["metadata"] |= {"generation": 2, "resourceVersion": "900"}
    office.world.api.version = 900
    office.world.deliver_job()
    await office.end()
    await office.deliver()
    assert (office.states(), office.world.reason("Notified")) == (
        {"team": "Delivered"},
        "True/Notified",
    )


async def test_a_namespace_s_receiver_needs_no_name() -> None:
    office = Office(ALL_LANES, TEAM, job=make_job("x"))
    await office.end()
    await office.deliver()
    assert office.states() == {"all-lanes": "Delivered"}


async def test_a_job_of_which_nobody_is_notified_has_no_word_of_it() -> None:
    office = Office(job=make_job("x"))
    await office.end()
    assert (has_notified(office), "notifications" in office.world.status()) == (False, False)


@pytest.mark.parametrize(
    ("says", "states"),
    [
        ({}, {}),
        ({"verdict": "Failed", "verdictReason": "Failed"}, {"red": "Pending"}),
        ({"comparisons": [WORSE]}, {"red": "Pending"}),
    ],
)
async def test_a_receiver_gets_what_it_asks_for(says: Json, states: dict[str, str]) -> None:
    office = Office(RED, job=make_job("x").with_spec("notify", ["red"]))
    await office.end(**says)
    assert office.states() == states
    reason = "Unknown/Notifying" if states else "True/Notified"
    assert office.world.reason("Notified") == reason


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
    office = Office()
    await office.end()
    office.restart((MAPS,))
    await office.world.reconcile()
    assert office.states() == {"team": "Dropped"}
    assert "not among the operator's receivers any more" in office.world.message("Notified")


async def test_what_somebody_wrote_into_a_status_notifies_nobody_else() -> None:
    """Who may write a status reaches no receiver that jobs of the namespace may not name."""
    office = Office(TEAM, MAPS, job=make_job("x"))
    forged = [{"receiver": "maps", "state": "Pending"}, {"receiver": 5}, "x", {"state": "Pending"}]
    office.world.api.objects["jobs", "x"]["status"] = {"notifications": forged}
    office.world.deliver_job()
    await office.end()
    assert "notifications" not in office.world.status()
    office.world.api.objects["jobs", "x"]["status"]["notifications"] = forged
    office.restart()
    for _ in range(2):
        await office.deliver()
    assert (office.got, office.states()) == ([], {"maps": "Dropped"})


async def test_a_job_is_not_removed_before_its_end_is_reported() -> None:
    office = Office(
        job=make_job("x").with_spec("notify", ["team"]).with_spec("ttlAfterFinished", "0s")
    )
    await office.end()
    await office.world.reconcile(after=60)
    assert office.world.api.named("jobs") == ["x"]
    await office.deliver()
    assert (office.world.api.named("jobs"), len(office.got)) == ([], 1)


async def test_a_job_that_is_gone_leaves_nothing_behind() -> None:
    office = Office()
    await office.end()
    office.world.view.drop_job(UID)
    await office.lines[0].deliver_due()
    assert list(office.courier.outcomes(UID)) == ["team"]
    await office.world.reconcile()
    assert office.courier.outcomes(UID) == {}


async def test_a_receiver_that_hangs_delays_no_reconcile() -> None:
    office = Office()
    office.hold = asyncio.Event()
    (task,) = office.courier.tasks()
    await office.end()
    await office.asked.wait()
    assert office.states() == {"team": "Pending"}
    office.world.api.calls.clear()
    await office.world.reconcile()
    assert office.world.api.calls == []
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def test_the_event_is_a_cloud_event_that_says_how_the_job_ended() -> None:
    job = make_job("x").with_spec("notify", ["team"])
    job.object["metadata"] |= {
        "labels": {"sim.bagpipe.io/schedule": "nightly"},
        "annotations": {"sim.bagpipe.io/commit": "0c1f", "example.com/token": "s3cr3t"},
    }
    office = Office(job=job)
    failure = {"case": "drive-1", "reason": "MessagesLost", "message": "7 messages were lost."}
    await office.end(
        verdict="Failed", verdictReason="Failed", failures=[failure], comparisons=[WORSE]
    )
    await office.deliver()
    (letter,) = office.got
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
    office.restart()
    again = office.world.view.job(UID)
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
