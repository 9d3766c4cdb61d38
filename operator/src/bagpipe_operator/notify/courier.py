"""Brings letters to receivers: each has a queue and a task of its own, so none waits for another.

Queues are in memory. What is still owed stands in the statuses of jobs, from which a new leader
fills them again; so a letter may arrive twice, with one identity.
"""

import asyncio
import logging
import random
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Protocol

from bagpipe_operator.notify.letter import Answer, Letter, Outcome
from bagpipe_operator.notify.metrics import NotificationMetrics
from bagpipe_operator.notify.turns import Turns, Waiting

logger = logging.getLogger(__name__)

# Of one receiver. A letter has a few kilobytes, at most 32.
MOST_WAITING = 1000
MOST_TRIES = 8
FIRST_PAUSE_SECONDS = 2.0
LONGEST_PAUSE_SECONDS = 600.0


class Post(Protocol):
    """What makes one try; see Sender."""

    async def post(self, letter: Letter) -> Answer:
        """One try, which ends by a deadline of its own."""


def pause(tries: int, chance: float) -> float:
    """Seconds after the nth try, from 1: fourfold each time, and by chance half of it or more.

    By chance, so that letters that were refused together don't come back together. `chance` is in
    [0, 1). All pauses of a letter together are 31 minutes at most.
    """
    longest = min(LONGEST_PAUSE_SECONDS, FIRST_PAUSE_SECONDS * 4.0 ** (tries - 1))
    return longest * (0.5 + chance / 2)


@dataclass
class Line:
    """The queue of one receiver."""

    receiver: str
    post: Post
    metrics: NotificationMetrics
    ended: Callable[[Letter, Outcome], None]
    leads: Callable[[], bool] = lambda: True
    monotonic: Callable[[], float] = time.monotonic
    chance: Callable[[], float] = random.random
    _queue: Turns = field(default_factory=Turns)
    _known: set[str] = field(default_factory=set)  # the jobs whose letters wait or are sent
    _news: asyncio.Event = field(default_factory=asyncio.Event)

    def offer(self, letter: Letter) -> None:
        """Takes a letter, unless it has it already; says so if there is no room.

        Who has none finds some with the namespace that has most.
        """
        if letter.uid in self._known:
            return
        if len(self._known) >= MOST_WAITING:
            gives_way = self._queue.give_way(letter.namespace)
            dropped = gives_way.letter if gives_way else letter
            self._end(dropped, Outcome("Dropped", f"{MOST_WAITING} were waiting for it."))
            if gives_way is None:
                return
        self._known.add(letter.uid)
        self._queue.add(letter, self.monotonic())
        self.metrics.waiting(self.receiver, len(self._queue))
        self._news.set()

    def clear(self) -> None:
        """Forgets what waits: whoever leads reads from the statuses what is owed."""
        self._queue.clear()
        self._known.clear()
        self.metrics.waiting(self.receiver, 0)

    async def run(self) -> None:
        """Delivers until cancelled."""
        while True:
            self._news.clear()
            seconds = await self.deliver_due()
            with suppress(TimeoutError):
                async with asyncio.timeout(seconds):
                    await self._news.wait()

    async def deliver_due(self) -> float | None:
        """Tries what is due, one after the other; seconds until there is more, None for never."""
        while (seconds := self._queue.seconds(self.monotonic())) is not None:
            if seconds > 0:
                return seconds
            if not self.leads():
                self.clear()
                return None
            waiting = self._queue.take(self.monotonic())
            if waiting is not None:
                await self._try(waiting)
        return None

    async def _try(self, waiting: Waiting) -> None:
        letter, begun = waiting.letter, self.monotonic()
        try:
            answer = await self.post.post(letter)
        except Exception:
            # A bug met with one letter must not end the task of all.
            logger.exception("%s: unexpected fault in notifying %s", letter.about, self.receiver)
            answer = Answer(False, "the operator met a bug of its own")
        self.metrics.tried(self.receiver, self.monotonic() - begun)
        waiting.tries += 1
        if letter.uid not in self._known:
            return  # forgotten meanwhile, since the lead was lost or the job is gone
        if answer.accepted:
            self._end(letter, Outcome("Delivered"))
        elif answer.final or waiting.tries >= MOST_TRIES:
            words = f"In the last of {waiting.tries} tries {answer.words}."
            self._end(letter, Outcome("Failed", words))
        else:
            seconds = max(pause(waiting.tries, self.chance()), answer.wait_seconds)
            waiting.due = self.monotonic() + seconds
            self._queue.put(waiting)
            self.metrics.waiting(self.receiver, len(self._queue))
            logger.info(
                "%s: %s is notified again in %.0f s: %s",
                letter.about, self.receiver, seconds, answer.words,
            )  # fmt: skip

    def _end(self, letter: Letter, outcome: Outcome) -> None:
        self._known.discard(letter.uid)
        self.metrics.ended(self.receiver, outcome.state)
        self.metrics.waiting(self.receiver, len(self._queue))
        if outcome.state != "Delivered":
            logger.warning(
                "%s: %s was not notified. %s", letter.about, self.receiver, outcome.message
            )
        self.ended(letter, outcome)


class Courier:
    """The lines of all receivers, and what became of letters until a status says so."""

    def __init__(self, woken: Callable[[str], None] = lambda _uid: None) -> None:
        self._lines: dict[str, Line] = {}
        self._outcomes: dict[str, dict[str, Outcome]] = {}
        self._woken = woken

    def add(self, line: Line) -> None:
        """Takes the line of one more receiver."""
        self._lines[line.receiver] = line

    def offer(self, letter: Letter) -> None:
        """Hands a letter to its receiver's line, at once and without waiting for anything.

        One whose outcome is known, and not written yet, is not sent again.
        """
        line = self._lines.get(letter.receiver)
        if line is not None and letter.receiver not in self.outcomes(letter.uid):
            line.offer(letter)

    def ended(self, letter: Letter, outcome: Outcome) -> None:
        """A letter's fate is known: its job is looked at, for its status to be written."""
        self._outcomes.setdefault(letter.uid, {})[letter.receiver] = outcome
        self._woken(letter.uid)

    def outcomes(self, uid: str) -> dict[str, Outcome]:
        """By receiver, what became of the letters about a job."""
        return self._outcomes.get(uid, {})

    def forget(self, uid: str) -> None:
        """The outcomes about a job are written, or it is gone."""
        self._outcomes.pop(uid, None)

    def begin_to_lead(self) -> None:
        """Forgets all: another replica may have led, and what is owed stands in the statuses."""
        self._outcomes.clear()
        for line in self._lines.values():
            line.clear()

    def tasks(self) -> list["asyncio.Task[None]"]:
        """The work of all lines, each by itself."""
        return [asyncio.create_task(line.run()) for line in self._lines.values()]
