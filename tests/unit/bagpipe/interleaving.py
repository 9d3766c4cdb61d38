"""Programs over one storage in memory, one step at a time, in every order that differs.

A step is one request to storage. Programs are deterministic, so what they have been answered is all
there is to know of them: a program is run once for each course of answers, and an order is followed
no further than to a state that was met before.
"""

import random
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from bagpipe.storage import StorageError

# (program, what becomes of its step): "ok", "lost" (done, and its answer is lost), "crash".
Choice = tuple[int, str]
Files = dict[str, bytes]
# Whoever asks more often than this tries the same again and again.
_MOST_STEPS = 200


@dataclass(frozen=True)
class Step:
    """A request that waits for its turn, and what it does to the files."""

    name: str
    uri: str
    act: Callable[[Files], Any] = field(repr=False)


@dataclass(frozen=True)
class Ended:
    """What a program returned, or the error that it raised."""

    result: Any = None
    error: Exception | None = None


@dataclass(frozen=True)
class Answer:
    """What a step gave or raised; no other one has the same text."""

    text: str
    value: Any = None
    error: StorageError | None = None


class _UnansweredError(BaseException):
    """What the program has asked last is not answered yet: it goes no further."""


class Door:
    """Storage as one program has it: answers it, and keeps what it asks first behind that."""

    def __init__(self, program: int, programs: int, answers: tuple[Answer, ...]) -> None:
        self.program = program
        self.programs = programs
        self.step: Step | None = None
        self._answers = iter(answers)

    def _ask(self, name: str, uri: str, act: Callable[[Files], Any]) -> Any:
        if self.step is None:
            if (answer := next(self._answers, None)) is not None:
                if answer.error is not None:
                    raise StorageError(str(answer.error))
                return answer.value
            self.step = Step(name, uri, act)
        raise _UnansweredError

    def exists(self, uri: str) -> bool:
        return bool(self._ask("exists", uri, lambda files: uri in files))

    def read_all(self, uri: str, _limit: int) -> bytes:
        def read(files: Files) -> bytes:
            if uri not in files:
                raise StorageError(f"{uri} is not there")
            return files[uri]

        return bytes(self._ask("read", uri, read))

    def open(self, uri: str) -> Any:
        data = self.read_all(uri, 0)
        return type("File", (), {"lines": lambda _self: iter(data.splitlines())})()

    def names(self, folder: str) -> list[str]:
        below = f"{folder}/"

        def names(files: Files) -> list[str]:
            return sorted(uri[len(below) :] for uri in files if uri.startswith(below))

        return list(self._ask("names", folder, names))

    def remove(self, uri: str) -> None:
        self._ask("remove", uri, lambda files: files.pop(uri, None) and None)

    def put_once(self, uri: str, data: bytes) -> bool:
        def put(files: Files) -> bool:
            there = uri in files
            files.setdefault(uri, data)
            return not there

        return bool(self._ask("put_once", uri, put))

    def check_put_once(self, folder: str) -> None:
        """This storage keeps its word, whose answers may be lost."""

    @contextmanager
    def create(self, uri: str) -> Iterator[Any]:
        data = bytearray()
        yield type("New", (), {"write": lambda _self, more: data.extend(more)})()
        written = bytes(data)
        self._ask("create", uri, lambda files: files.update({uri: written}))


class Programs:
    """So many of one kind beside each other."""

    def __init__(self, count: int, program: Callable[[Door], Any]) -> None:
        self.count = count
        self._program = program
        self._known: dict[tuple[int, tuple[str, ...]], Step | Ended] = {}

    def after(self, number: int, answers: tuple[Answer, ...]) -> Step | Ended:
        """What a program asks next when it was answered so, or its end."""
        course = number, tuple(each.text for each in answers)
        if course not in self._known:
            self._known[course] = self._run(Door(number, self.count, answers))
        return self._known[course]

    def _run(self, door: Door) -> Step | Ended:
        try:
            ended = Ended(self._program(door))
        except _UnansweredError:
            ended = Ended()
        except Exception as error:  # noqa: BLE001  who follows the programs reports it
            ended = Ended(error=error)
        return door.step or ended


@dataclass(frozen=True)
class State:
    """The files, what each program was answered, who has crashed, and how it all came about."""

    programs: Programs
    files: Mapping[str, bytes]
    answers: tuple[tuple[Answer, ...], ...]
    crashed: frozenset[int] = frozenset()
    faults: tuple[str, ...] = ()
    order: tuple[Choice, ...] = ()

    @property
    def key(self) -> int:
        """What may still become of it all."""
        answers = tuple(tuple(each.text for each in answered) for answered in self.answers)
        return hash((answers, tuple(sorted(self.files.items())), self.crashed, self.faults))

    @property
    def ends(self) -> dict[int, Ended]:
        """Of those that have ended, and not by a crash."""
        found = {number: self._next(number) for number in self._alive()}
        return {number: each for number, each in found.items() if isinstance(each, Ended)}

    def choices(self, may_fail: bool) -> list[Choice]:
        """One fault in all: an answer is lost, of a step that changes something, or one is dead."""
        found = []
        for number in self._alive():
            step = self._next(number)
            if isinstance(step, Ended):
                continue
            ways = ["ok"]
            if may_fail and not self.faults:
                changes = step.name in {"put_once", "create"}
                ways = ["ok", "lost", "crash"] if changes else ["ok", "crash"]
            found += [(number, how) for how in ways]
        return found

    def then(
        self, choice: Choice, forbidden: Callable[[Mapping[str, bytes], Step], None]
    ) -> "State":
        """One step as a whole, answered or not."""
        number, how = choice
        order = (*self.order, choice)
        assert len(order) <= _MOST_STEPS, order
        faults = self.faults if how == "ok" else (*self.faults, how)
        if how == "crash":
            return replace(self, crashed=self.crashed | {number}, faults=faults, order=order)
        step = self._next(number)
        assert isinstance(step, Step)
        forbidden(self.files, step)
        files = dict(self.files)
        answer = _answer(step, files, lost=how == "lost")
        answers = list(self.answers)
        answers[number] = (*answers[number], answer)
        return replace(self, files=files, answers=tuple(answers), faults=faults, order=order)

    def _alive(self) -> list[int]:
        return [number for number in range(self.programs.count) if number not in self.crashed]

    def _next(self, number: int) -> Step | Ended:
        return self.programs.after(number, self.answers[number])


def _answer(step: Step, files: Files, lost: bool) -> Answer:
    asked = f"{step.name} {step.uri}"
    try:
        value = step.act(files)
    except StorageError as error:
        return Answer(f"{asked}: {error}", error=error)
    if lost:
        return Answer(f"{asked}: lost", error=StorageError(f"{step.uri}: the answer was lost"))
    return Answer(f"{asked}: {value!r}", value)


def orders(
    programs: Programs,
    forbidden: Callable[[Mapping[str, bytes], Step], None],
    ended: Callable[[State], None],
    files: Mapping[str, bytes] | None = None,
    may_fail: bool = False,
    most: int | None = None,
) -> int:
    """Follow every order that leads to a state not met before; how many states there are.

    `forbidden` looks at each step before it is done, and `ended` at each state in which no program
    goes on. With `most`: so many runs, drawn from all that are left by a fixed seed.
    """
    met: set[int] = set()
    begin = State(programs, files or {}, ((),) * programs.count)
    left: list[tuple[State, Choice | None]] = [(begin, None)]
    rng = random.Random(1)  # noqa: S311
    runs = 0
    while left and (most is None or runs < most):
        runs += 1
        state, choice = left.pop(rng.randrange(len(left)))
        if choice is not None:
            state = state.then(choice, forbidden)
        while (key := state.key) not in met:
            met.add(key)
            choices = state.choices(may_fail)
            if not choices:
                ended(state)
                break
            left += [(state, other) for other in choices[1:]]
            state = state.then(choices[0], forbidden)
    return len(met)
