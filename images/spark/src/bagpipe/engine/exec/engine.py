"""How a case of a program is run and judged."""

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path

from bagpipe.engine.engine import Attempt, Played, Program, own_program
from bagpipe.engine.exec.judge import judge_program
from bagpipe.engine.exec.outputs import collected
from bagpipe.engine.exec.result import RESULT
from bagpipe.faults import FaultPolicy
from bagpipe.plan.case import Case
from bagpipe.source.source import JobSource, Turns
from bagpipe.spec import SimulationJobSpec, Stack
from bagpipe.storage import Storage
from bagpipe.wire.session import Answer, InputFile, Sink, Sinks, engine_result


class Exec:
    """stack.engine: exec."""

    def input(self, source: JobSource, case: Case, storage: Storage) -> InputFile | Turns:
        """The case's file under its own name, so that it may be given back under that name."""
        found = source.input(case, storage)
        if isinstance(found, InputFile):
            return dataclasses.replace(found, name=source.file_name(case))
        return found

    def play(self, attempt: Attempt, exchange: Callable[[Sink | Sinks], Answer]) -> Played:
        """Keeps the program's files, unless its word can't be taken."""
        with collected(attempt.storage, attempt.results, attempt.name) as outputs:
            answer = exchange(outputs)
            judgement = judge_program(
                engine_result(answer, RESULT), FaultPolicy(attempt.spec.fault_policy)
            )
        return Played(judgement, outputs.names or None, answer)

    def programs(self, stack: Stack) -> list[Program]:
        """The program."""
        return [own_program(stack)]

    def by_hand(
        self,
        _case: Case,
        _spec: SimulationJobSpec,
        _source: JobSource,
        _storage: Storage,
        _bag: Path,
    ) -> Iterator[str]:
        """A program speaks with its agent alone."""
        return iter(())


ENGINE = Exec()
