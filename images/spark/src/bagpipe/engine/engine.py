"""What every engine can do."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from bagpipe.judgement import Judgement
from bagpipe.plan.case import Case
from bagpipe.source.source import JobSource, Turns
from bagpipe.spec import SimulationJobSpec, Stack
from bagpipe.storage import Storage
from bagpipe.wire.session import Answer, InputFile, Sink, Sinks


@dataclass(frozen=True)
class Attempt:
    """One run of a case: what it is of, and where what it records goes.

    `results` is the URI of the job's folder, `name` a prefix of this attempt's own in it.
    """

    case: Case
    spec: SimulationJobSpec
    source: JobSource
    storage: Storage
    results: str
    name: str


@dataclass(frozen=True)
class Played:
    """What an attempt came to.

    `recorded` are names below the job's results; `findings` are those of the criteria, None of an
    engine that has none; `log` is what the stack's nodes wrote and when, `images` what cameras
    showed when a criterion failed.
    """

    judgement: Judgement
    recorded: str | list[str] | None
    answer: Answer
    findings: list[dict[str, Any]] | None = None
    log: list[dict[str, Any]] = field(default_factory=list)
    images: list[dict[str, Any]] = field(default_factory=list)


@dataclass(frozen=True)
class Program:
    """A program that a machine needs to run a stack, or a library.

    `why` begins the sentence that it is missing, and `remedy` says how it is found. `found` looks
    for it by the environment that the stack is started with; None: it is looked for on PATH.
    """

    name: str
    why: str
    remedy: str = "put its folder on PATH"
    found: Callable[[Mapping[str, str]], bool] | None = None


def own_program(stack: Stack, remedy: str = Program.remedy) -> Program:
    """The one that the stack's command starts."""
    return Program(stack.command[0], "stack.command starts", remedy)


class Engine(Protocol):
    """Stateless: one object for all jobs."""

    def input(self, source: JobSource, case: Case, storage: Storage, /) -> InputFile | Turns:
        """What the agent is sent. Raises SessionError and StorageError."""

    def play(self, attempt: Attempt, exchange: Callable[[Sink | Sinks], Answer], /) -> Played:
        """Let the exchange with the agent write into a sink, keep what was written, and judge.

        What the exchange raises leaves nothing behind; what a fault of the judging leaves is not in
        the job's manifest, and goes at its end. Raises SessionError and StorageError.
        """

    def programs(self, stack: Stack, /) -> list[Program]:
        """The programs that a machine needs for the stack."""

    def by_hand(
        self, case: Case, spec: SimulationJobSpec, source: JobSource, storage: Storage, bag: Path, /
    ) -> Iterator[str]:
        """How to play a case's bag without Bagpipe's worker, as lines; none where that can't be."""
