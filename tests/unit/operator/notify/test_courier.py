"""Queues of letters over a clock that the test moves: pauses, bounds, and who waits for whom."""

import asyncio
import itertools
import random
from collections import Counter
from dataclasses import dataclass, field

import pytest
from prometheus_client import CollectorRegistry

from bagpipe_operator.notify.courier import (
    LONGEST_PAUSE_SECONDS,
    MOST_TRIES,
    MOST_WAITING,
    Courier,
    Line,
    pause,
)
from bagpipe_operator.notify.letter import Answer, Letter, Outcome
from bagpipe_operator.notify.metrics import NotificationMetrics
from bagpipe_operator.notify.turns import Turns
from tests.unit.operator.builders import Clock

REFUSED = Answer(False, "it answered 500")


def letter(uid: str = "u", receiver: str = "team", namespace: str = "lanes") -> Letter:
    return Letter(uid, f"{namespace}/{uid}", receiver, f"{uid}-ended", b"{}")


@dataclass
class FakePost:
    """Answers as it is asked to, the last answer for ever; keeps the identities that it got."""

    clock: Clock
    answers: list[Answer | Exception] = field(default_factory=lambda: [Answer(True)])
    got: list[tuple[float, str]] = field(default_factory=list)
    takes: float = 0.0
    hold: asyncio.Event | None = None

    async def post(self, letter: Letter) -> Answer:
        self.got.append((self.clock.seconds, letter.identity))
        self.clock.advance(self.takes)
        if self.hold is not None:
            await self.hold.wait()
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if isinstance(answer, Exception):
            raise answer
        return answer


class Office:
    """A courier with lines whose clock, chance and lead the test has."""

    def __init__(self, *receivers: str) -> None:
        self.clock, self.registry = Clock(), CollectorRegistry()
        self.leads, self.chance = True, 0.0
        self.woken: list[str] = []
        self._news = asyncio.Event()
        self.courier = Courier(self._wake)
        names = receivers or ("team",)
        metrics = NotificationMetrics(names, self.registry)
        self.posts = {name: FakePost(self.clock) for name in names}
        self.lines = {
            name: Line(
                name, post, metrics, self.courier.ended, lambda: self.leads, self.clock.monotonic,
                lambda: self.chance,
            )
            for name, post in self.posts.items()
        }  # fmt: skip
        for line in self.lines.values():
            self.courier.add(line)

    def sample(self, name: str, **labels: str) -> float | None:
        return self.registry.get_sample_value(name, {"receiver": "team"} | labels)

    def ended(self, result: str) -> float | None:
        return self.sample("bagpipe_notifications_total", result=result)

    def _wake(self, uid: str) -> None:
        self.woken.append(uid)
        self._news.set()

    async def until_woken_for(self, count: int) -> None:
        """Lets the tasks of the lines work until so many outcomes are known."""
        while len(self.woken) < count:
            self._news.clear()
            await self._news.wait()

    async def until_nothing_is_due(self) -> None:
        """Lets time pass as the line itself would wait, until it waits for news alone."""
        while (seconds := await self.lines["team"].deliver_due()) is not None:
            self.clock.advance(seconds)


async def test_a_letter_is_delivered_once_and_its_job_looked_at() -> None:
    office = Office()
    for _ in range(3):
        office.courier.offer(letter())
    await office.until_nothing_is_due()
    assert office.posts["team"].got == [(0.0, "u-ended")]
    assert office.courier.outcomes("u") == {"team": Outcome("Delivered")}
    assert office.woken == ["u"]
    office.courier.offer(letter())  # its status is not written yet
    await office.until_nothing_is_due()
    assert len(office.posts["team"].got) == 1
    assert (office.ended("delivered"), office.ended("failed"), office.ended("dropped")) == (1, 0, 0)


async def test_tries_are_few_and_pauses_grow() -> None:
    office = Office()
    office.posts["team"].answers = [REFUSED]
    office.courier.offer(letter())
    await office.until_nothing_is_due()
    moments = [moment for moment, _ in office.posts["team"].got]
    assert len(moments) == MOST_TRIES == 8
    between = [after - before for before, after in itertools.pairwise(moments)]
    assert between == [1.0, 4.0, 16.0, 64.0, 256.0, 300.0, 300.0]
    outcome = Outcome("Failed", "In the last of 8 tries it answered 500.")
    assert office.courier.outcomes("u") == {"team": outcome}
    assert office.ended("failed") == 1
    assert office.sample("bagpipe_notification_seconds_count") == 8


def test_pauses_are_spread_by_chance_within_bounds() -> None:
    chance = random.Random(7)  # noqa: S311
    assert [pause(n, 0.0) for n in (1, 2, 3)] == [1.0, 4.0, 16.0]
    many = [pause(2, chance.random()) for _ in range(1000)]
    assert 4.0 <= min(many) < 4.1
    assert 7.9 < max(many) < 8.0
    assert max(pause(n, 0.999) for n in range(1, 200)) < LONGEST_PAUSE_SECONDS
    assert sum(pause(n, 1.0) for n in range(1, MOST_TRIES)) == 1882


async def test_what_helps_after_a_while_is_delivered() -> None:
    office = Office()
    office.posts["team"].answers = [REFUSED, ValueError("a bug"), Answer(True)]
    office.courier.offer(letter())
    await office.until_nothing_is_due()
    assert [moment for moment, _ in office.posts["team"].got] == [0.0, 1.0, 5.0]
    assert office.courier.outcomes("u")["team"].state == "Delivered"


async def test_who_is_gone_is_asked_once_and_who_asks_for_time_gets_it() -> None:
    office = Office()
    office.posts["team"].answers = [Answer(False, "it answered 429", wait_seconds=77), Answer(True)]
    office.courier.offer(letter())
    await office.until_nothing_is_due()
    assert [moment for moment, _ in office.posts["team"].got] == [0.0, 77.0]
    office.posts["team"].answers = [Answer(False, "it answered 410", final=True)]
    office.courier.offer(letter("v"))
    await office.until_nothing_is_due()
    assert len(office.posts["team"].got) == 3
    assert office.courier.outcomes("v")["team"].message == "In the last of 1 tries it answered 410."


async def test_a_letter_that_waits_for_its_next_try_holds_up_no_other() -> None:
    office = Office()
    office.posts["team"].answers = [REFUSED, Answer(True)]
    office.courier.offer(letter("a"))
    office.courier.offer(letter("b"))
    assert await office.lines["team"].deliver_due() == 1.0
    assert [who for _, who in office.posts["team"].got] == ["a-ended", "b-ended"]
    assert list(office.courier.outcomes("b")) == ["team"]


async def test_what_finds_no_room_is_dropped_counted_and_reported(
    caplog: pytest.LogCaptureFixture,
) -> None:
    office = Office()
    for number in range(MOST_WAITING + 3):
        office.courier.offer(letter(f"u{number}"))
    assert office.sample("bagpipe_notifications_waiting") == MOST_WAITING == 1000
    assert office.ended("dropped") == 3
    assert office.courier.outcomes("u1002") == {
        "team": Outcome("Dropped", "1000 were waiting for it.")
    }
    assert office.courier.outcomes("u999") == {}
    assert "lanes/u1002: team was not notified. 1000 were waiting for it." in caplog.text
    await office.until_nothing_is_due()
    assert (len(office.posts["team"].got), office.ended("delivered")) == (1000, 1000)
    assert office.sample("bagpipe_notifications_waiting") == 0


async def test_a_team_that_floods_a_receiver_drops_its_own_and_no_other_team_s() -> None:
    office = Office()
    for number in range(MOST_WAITING + 5):
        office.courier.offer(letter(f"flood{number}", namespace="loud"))
    for number in range(2):
        office.courier.offer(letter(f"quiet{number}", namespace="quiet"))
    dropped = [
        uid for uid in office.woken if office.courier.outcomes(uid)["team"].state == "Dropped"
    ]
    assert dropped == [f"flood{n}" for n in (1000, 1001, 1002, 1003, 1004, 999, 998)]
    assert office.sample("bagpipe_notifications_waiting") == MOST_WAITING
    await office.until_nothing_is_due()
    order = [who for _, who in office.posts["team"].got]
    assert order[:5] == [
        "flood0-ended", "quiet0-ended", "flood1-ended", "quiet1-ended", "flood2-ended",
    ]  # fmt: skip
    assert len(order) == MOST_WAITING


async def test_teams_share_the_room() -> None:
    office = Office()
    for team in "ab":
        for number in range(MOST_WAITING):
            office.courier.offer(letter(f"{team}{number}", namespace=team))
    office.courier.offer(letter("c0", namespace="c"))
    assert office.ended("dropped") == MOST_WAITING + 1
    await office.until_nothing_is_due()
    half = MOST_WAITING // 2
    teams = Counter(who[0] for _, who in office.posts["team"].got)
    assert sorted(teams.values()) == [1, half - 1, half]
    assert (teams["c"], office.ended("delivered")) == (1, MOST_WAITING)


def test_what_was_tried_already_gives_way_last() -> None:
    turns = Turns()
    for number in range(4):
        turns.add(letter(f"a{number}", namespace="a"), 0.0)
    for _ in range(2):
        tried = turns.take(0.0)
        assert tried is not None
        tried.tries, tried.due = 1, 9.0
        turns.put(tried)
    found = [turns.give_way("b") for _ in range(4)]
    assert [each and each.letter.uid for each in found] == ["a3", "a2", "a1", None]
    assert (len(turns), turns.seconds(4.0), turns.take(8.9)) == (1, 5.0, None)


async def test_a_receiver_that_hangs_holds_up_neither_another_nor_who_offers() -> None:
    office = Office("team", "other")
    office.posts["team"].hold = asyncio.Event()
    tasks = office.courier.tasks()
    for number in range(5):
        for name in ("team", "other"):
            office.courier.offer(letter(f"u{number}", name))
    await office.until_woken_for(5)
    assert len(office.posts["team"].got) == 1
    assert {name for n in range(5) for name in office.courier.outcomes(f"u{n}")} == {"other"}
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def test_without_the_lead_nothing_is_sent_and_with_it_all_is_read_again() -> None:
    office = Office()
    office.courier.offer(letter())
    office.leads = False
    await office.until_nothing_is_due()
    assert office.posts["team"].got == []
    office.leads = True
    office.courier.begin_to_lead()
    office.courier.offer(letter())
    await office.until_nothing_is_due()
    assert len(office.posts["team"].got) == 1
    office.courier.begin_to_lead()
    assert office.courier.outcomes("u") == {}


async def test_news_wake_the_task_that_waits_for_none() -> None:
    office = Office()
    task = asyncio.create_task(office.lines["team"].run())
    for count, uid in enumerate(("a", "b"), 1):
        await asyncio.sleep(0)
        office.courier.offer(letter(uid))
        await office.until_woken_for(count)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert len(office.posts["team"].got) == 2


async def test_who_is_no_receiver_any_more_gets_nothing() -> None:
    office = Office()
    office.courier.offer(letter("u", "gone"))
    assert office.courier.outcomes("u") == {}
