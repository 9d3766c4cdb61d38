"""Programs over one storage in memory, one step at a time, in every order that differs.

A step is one request to storage. Programs are deterministic, so what they have been answered is all
there is to know of them: an order that leads to a state that was met before is not followed again.
"""

import random
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from bagpipe.storage import StorageError

# (program, what becomes of its step): "ok", "lost" (done, and its answer is lost), "crash".
Choice = tuple[int, str]
_STUCK_SECONDS = 60.0


class CrashError(BaseException):
    """The program's machine is gone; nothing of it is done any more."""


@dataclass
class Step:
    """A request that waits for its turn."""

    name: str
    uri: str


@dataclass
class World:
    """The files, the programs that wait, and what each was answered."""

    programs: int
    forbidden: Callable[["World", Step], None]
    files: dict[str, bytes] = field(default_factory=dict)
    may_fail: bool = False
    waiting: dict[int, Step] = field(default_factory=dict)
    answers: dict[int, list[str]] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    _granted: dict[int, str] = field(default_factory=dict)
    _turns: list[threading.Lock] = field(init=False)
    _back: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        self._turns = [threading.Lock() for _ in range(self.programs)]
        for lock in [*self._turns, self._back]:
            lock.acquire()

    def ask(self, program: int, name: str, uri: str, act: Callable[[], Any]) -> Any:
        """One step: waits for its turn, is done as a whole, and is answered or not."""
        step = Step(name, uri)
        self.waiting[program] = step
        self._back.release()
        assert self._turns[program].acquire(timeout=_STUCK_SECONDS)
        how = self._granted.pop(program)
        del self.waiting[program]
        if how == "crash":
            raise CrashError
        self.forbidden(self, step)
        try:
            answer = act()
        except StorageError as error:
            self.answers.setdefault(program, []).append(f"{name} {uri}: {error}")
            raise
        reply = "lost" if how == "lost" else repr(answer)
        self.answers.setdefault(program, []).append(f"{name} {uri}: {reply}")
        if how == "lost":
            raise StorageError(f"{uri}: the answer was lost")
        return answer

    def await_one(self) -> None:
        """Until the one program that runs waits for its turn, or has ended."""
        assert self._back.acquire(timeout=_STUCK_SECONDS)

    def grant(self, choice: Choice) -> None:
        """Give a program its turn, and wait until it waits for another one."""
        program, how = choice
        self._granted[program] = how
        if how != "ok":
            self.faults.append(how)
        self._turns[program].release()
        self.await_one()

    def end(self) -> None:
        """The program that runs has ended."""
        self._back.release()

    def state(self) -> int:
        """What may still become of it all."""
        answers = tuple((n, tuple(reply)) for n, reply in sorted(self.answers.items()))
        files = tuple(sorted(self.files.items()))
        return hash((answers, files, tuple(sorted(self.waiting)), tuple(self.faults)))


@dataclass(frozen=True)
class Door:
    """Storage as one program has it."""

    world: World
    program: int

    def _ask(self, name: str, uri: str, act: Callable[[], Any]) -> Any:
        return self.world.ask(self.program, name, uri, act)

    def _read(self, uri: str) -> bytes:
        if uri not in self.world.files:
            raise StorageError(f"{uri} is not there")
        return self.world.files[uri]

    def exists(self, uri: str) -> bool:
        return bool(self._ask("exists", uri, lambda: uri in self.world.files))

    def read_all(self, uri: str, _limit: int) -> bytes:
        return bytes(self._ask("read", uri, lambda: self._read(uri)))

    def open(self, uri: str) -> Any:
        data = self.read_all(uri, 0)
        return type("File", (), {"lines": lambda _self: iter(data.splitlines())})()

    def names(self, folder: str) -> list[str]:
        below = f"{folder}/"

        def names() -> list[str]:
            return sorted(uri[len(below) :] for uri in self.world.files if uri.startswith(below))

        return list(self._ask("names", folder, names))

    def remove(self, uri: str) -> None:
        self._ask("remove", uri, lambda: self.world.files.pop(uri, None) and None)

    def put_once(self, uri: str, data: bytes) -> bool:
        def put() -> bool:
            return self.world.files.setdefault(uri, data) is data

        return bool(self._ask("put_once", uri, put))

    def check_put_once(self, folder: str) -> None:
        """This storage keeps its word, whose answers may be lost."""

    @contextmanager
    def create(self, uri: str) -> Iterator[Any]:
        data = bytearray()
        yield type("New", (), {"write": lambda _self, more: data.extend(more)})()
        self._ask("create", uri, lambda: self.world.files.update({uri: bytes(data)}))


def run(
    world: World, programs: list[Callable[[Door], None]], order: list[Choice]
) -> Iterator[tuple[int, list[Choice]]]:
    """Follow an order as far as it goes, then the first that waits; gives each state and what
    could be chosen there.
    """
    threads = [
        threading.Thread(target=_program, args=(world, number, program), daemon=True)
        for number, program in enumerate(programs)
    ]
    for thread in threads:
        thread.start()
        world.await_one()
    at = 0
    while waiting := sorted(world.waiting):
        choices = [(number, how) for number in waiting for how in _ways(world, number)]
        yield world.state(), choices
        world.grant(order[at] if at < len(order) else choices[0])
        at += 1
    for thread in threads:
        thread.join(_STUCK_SECONDS)


def _ways(world: World, number: int) -> list[str]:
    """One fault in all: an answer is lost, of a step that changes something, or one is dead."""
    if world.faults or not world.may_fail:
        return ["ok"]
    changes = world.waiting[number].name in {"put_once", "create"}
    return ["ok", "lost", "crash"] if changes else ["ok", "crash"]


def _program(world: World, number: int, program: Callable[[Door], None]) -> None:
    try:
        program(Door(world, number))
    except CrashError:
        world.answers.setdefault(number, []).append("crashed")
    finally:
        world.end()


def orders(
    follow: Callable[[list[Choice]], Iterator[tuple[int, list[Choice]]]], most: int | None = None
) -> int:
    """Follow every order that leads to a state not met before; how many states there are.

    With `most`: so many runs, drawn from all that are left by a fixed seed.
    """
    met: set[int] = set()
    left: list[list[Choice]] = [[]]
    rng = random.Random(1)  # noqa: S311
    runs = 0
    while left and (most is None or runs < most):
        runs += 1
        order = left.pop(rng.randrange(len(left)))
        taken: list[Choice] = []
        for at, (state, choices) in enumerate(follow(order)):
            chosen = order[at] if at < len(order) else choices[0]
            if at >= len(order) and state not in met:
                met.add(state)
                left += [[*taken, other] for other in choices[1:]]
            taken.append(chosen)
    return len(met)
