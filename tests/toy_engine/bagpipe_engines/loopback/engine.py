"""How a case of a loopback is run and judged."""

import dataclasses
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path

from bagpipe.engine.engine import Attempt, Played, Program, own_program
from bagpipe.faults import FaultPolicy
from bagpipe.judgement import Judgement, ends, first_that_counts
from bagpipe.plan.case import Case
from bagpipe.plan.variant import stack_of
from bagpipe.source.source import JobSource, Turns
from bagpipe.spec import SimulationJobSpec, Stack
from bagpipe.storage import Storage
from bagpipe.wire.session import Answer, InputFile, Sink, Sinks


class Counter:
    """Takes bytes and keeps their number alone."""

    def __init__(self) -> None:
        self.bytes = 0

    def write(self, data: bytes, /) -> None:
        """Count them."""
        self.bytes += len(data)


class Loopback:
    """stack.engine: loopback."""

    def input(self, source: JobSource, case: Case, storage: Storage) -> InputFile | Turns:
        """The fragment under a plain name, which a program may give back."""
        found = source.input(case, storage)
        if isinstance(found, InputFile):
            return dataclasses.replace(found, name=source.file_name(case))
        return found

    def play(self, attempt: Attempt, exchange: Callable[[Sink | Sinks], Answer]) -> Played:
        """Keeps nothing; passes where as many bytes came back as were sent."""
        received = Counter()
        answer = exchange(received)
        policy = FaultPolicy(attempt.spec.fault_policy)
        verdict = judge(answer.input_bytes, received.bytes)
        return Played(first_that_counts(ends(answer.result), policy, verdict), None, answer)

    def programs(self, stack: Stack) -> list[Program]:
        """The program."""
        return [own_program(stack)]

    def by_hand(
        self, case: Case, spec: SimulationJobSpec, _source: JobSource, _storage: Storage, bag: Path
    ) -> Iterator[str]:
        """A shell can do it."""
        command = shlex.join(stack_of(spec, case.conditions).command)
        yield f"  {command} < {shlex.quote(str(bag))} | cmp - {shlex.quote(str(bag))}"


def judge(sent: int, received: int) -> Judgement:
    """The verdict by what came back."""
    if sent == received:
        return Judgement("passed")
    return Judgement("failed", "BytesMissing", f"{received} of {sent} bytes came back")


ENGINE = Loopback()
