"""Turns at writing to the API server, of which no namespace has all."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from weakref import WeakValueDictionary


class WriteTurns:
    """So many writes at once of one namespace, and so many more that only others may make.

    What is created in a namespace may take ten seconds each time, as behind a webhook that hangs.
    """

    def __init__(self, of_one: int, for_others: int) -> None:
        self._most_of_one = of_one
        self._all = asyncio.Semaphore(of_one + for_others)
        # Kept by those who have or await a turn.
        self._of: WeakValueDictionary[str, asyncio.Semaphore] = WeakValueDictionary()

    @asynccontextmanager
    async def taken(self, namespace: str) -> AsyncIterator[None]:
        """A turn of that namespace, as soon as there is one."""
        own = self._of.get(namespace)
        if own is None:
            own = self._of[namespace] = asyncio.Semaphore(self._most_of_one)
        async with own, self._all:
            yield
