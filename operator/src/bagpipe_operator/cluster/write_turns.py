"""Turns at writing to the API server, of which no namespaces have all."""

import asyncio
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

# A busy API server takes less for a write; what takes longer is held up, and gives it little to do.
SLOW_SECONDS = 1.0


class WriteTurns:
    """So many writes at once of one namespace, and so many more that only others may make.

    What is created in a namespace may take ten seconds each time, as behind a webhook that hangs.
    So the next turn goes to the namespace that has fewest, and one that has none does not wait for
    writes that take more than SLOW_SECONDS: up to `beside_slow` more are made beside these.
    """

    def __init__(self, of_one: int, for_others: int, beside_slow: int) -> None:
        self._most_of_one = of_one
        self._most = of_one + for_others
        self._most_beside_slow = self._most + beside_slow
        self._had_by: Counter[str] = Counter()
        self._slow = 0
        self._waiting: dict[_Turn, None] = {}  # who waits longest comes first

    @asynccontextmanager
    async def taken(self, namespace: str) -> AsyncIterator[None]:
        """A turn of that namespace, as soon as there is one."""
        turn = _Turn(namespace)
        self._waiting[turn] = None
        self._give()
        try:
            await turn.given
            yield
        finally:
            self._end(turn)

    def _give(self) -> None:
        while (turn := self._next()) is not None:
            del self._waiting[turn]
            self._had_by[turn.namespace] += 1
            loop = asyncio.get_running_loop()
            turn.until_slow = loop.call_later(SLOW_SECONDS, self._note_slow, turn)
            turn.given.set_result(None)

    def _next(self) -> "_Turn | None":
        """Whose turn it is, if there is one to be had."""
        had = self._had_by
        waiting = (each for each in self._waiting if not each.given.cancelled())
        may = (each for each in waiting if had[each.namespace] < self._most_of_one)
        turn = min(may, key=lambda each: had[each.namespace], default=None)
        if turn is None or had.total() < self._most:
            return turn
        passes = not had[turn.namespace] and had.total() - self._slow < self._most
        return turn if passes and had.total() < self._most_beside_slow else None

    def _note_slow(self, turn: "_Turn") -> None:
        turn.is_slow = True
        self._slow += 1
        self._give()

    def _end(self, turn: "_Turn") -> None:
        """Who was cancelled may have waited still."""
        if turn.until_slow is None:
            del self._waiting[turn]
            return
        turn.until_slow.cancel()
        self._slow -= turn.is_slow
        self._had_by[turn.namespace] -= 1
        if not self._had_by[turn.namespace]:
            del self._had_by[turn.namespace]
        self._give()


class _Turn:
    """One write's, which it waits for or has."""

    def __init__(self, namespace: str) -> None:
        self.namespace = namespace
        self.given: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.until_slow: asyncio.TimerHandle | None = None  # none while it waits
        self.is_slow = False
