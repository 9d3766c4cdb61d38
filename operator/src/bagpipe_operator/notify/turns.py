"""What waits for one receiver: in turn by namespace, and with room for those who have little."""

import heapq
import itertools
from collections import Counter, deque
from dataclasses import dataclass, field

from bagpipe_operator.notify.letter import Letter


@dataclass(order=True)
class Waiting:
    """A letter in the queue, in the order of when it is due."""

    due: float
    number: int
    letter: Letter = field(compare=False)
    tries: int = field(default=0, compare=False)


class Turns:
    """Letters by when they are due. Of those that are, each namespace has one in turn, so that a
    thousand of one team hold up another's by one.
    """

    def __init__(self) -> None:
        self._later: list[Waiting] = []
        self._due: dict[str, deque[Waiting]] = {}
        self._numbers = itertools.count()

    def __len__(self) -> int:
        return len(self._later) + sum(len(each) for each in self._due.values())

    def add(self, letter: Letter, due: float) -> None:
        """One that was not tried yet."""
        self.put(Waiting(due, next(self._numbers), letter))

    def put(self, waiting: Waiting) -> None:
        """One that is to be tried when it is due."""
        heapq.heappush(self._later, waiting)

    def seconds(self, now: float) -> float | None:
        """Until one is due, nought for one that is; None where there is none."""
        if self._due:
            return 0.0
        return max(0.0, self._later[0].due - now) if self._later else None

    def take(self, now: float) -> Waiting | None:
        """The next one that is due, of the namespace whose turn it is."""
        while self._later and self._later[0].due <= now:
            ripe = heapq.heappop(self._later)
            self._due.setdefault(ripe.letter.namespace, deque()).append(ripe)
        if not self._due:
            return None
        namespace, letters = next(iter(self._due.items()))
        taken = letters.popleft()
        del self._due[namespace]
        if letters:
            self._due[namespace] = letters  # behind all others
        return taken

    def give_way(self, namespace: str) -> Waiting | None:
        """Takes out a letter of the namespace that has most, where that is more than this one has,
        with one more; the latest of those that were not tried, if there is one.
        """
        has = Counter(each.letter.namespace for each in self._all())
        most = max(has, key=lambda name: has[name], default=namespace)
        if has[most] <= has[namespace] + 1:
            return None
        of_it = (each for each in self._all() if each.letter.namespace == most)
        found = max(of_it, key=lambda each: (each.tries == 0, each.number))
        self._remove(found)
        return found

    def clear(self) -> None:
        """Forgets all."""
        self._later.clear()
        self._due.clear()

    def _all(self) -> "itertools.chain[Waiting]":
        return itertools.chain(self._later, *self._due.values())

    def _remove(self, waiting: Waiting) -> None:
        letters = self._due.get(waiting.letter.namespace, deque())
        if waiting in letters:
            letters.remove(waiting)
            if not letters:
                del self._due[waiting.letter.namespace]
            return
        self._later.remove(waiting)
        heapq.heapify(self._later)
