"""How a case of ROS 1 nodes is played, recorded and judged."""

import json
import posixpath
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path

from bagpipe.engine.engine import Attempt, Played, Program, own_program
from bagpipe.engine.ros1.by_hand import play_command
from bagpipe.engine.ros1.criteria import judged_by_criteria
from bagpipe.engine.ros1.judge import judge
from bagpipe.engine.ros1.result import RESULT
from bagpipe.faults import FaultPolicy
from bagpipe.plan.case import Case
from bagpipe.plan.variant import stack_of
from bagpipe.source.source import JobSource, Turns
from bagpipe.spec import SimulationJobSpec, Stack
from bagpipe.storage import Storage
from bagpipe.wire.session import Answer, InputFile, Sink, Sinks, engine_result

_SOURCED = "put its folder on PATH (such as by sourcing setup.bash)"


class Ros1:
    """stack.engine: ros1."""

    def input(self, source: JobSource, case: Case, storage: Storage) -> InputFile | Turns:
        """What the source has."""
        return source.input(case, storage)

    def play(self, attempt: Attempt, exchange: Callable[[Sink | Sinks], Answer]) -> Played:
        """Keeps the recorded bag; judges delivery first, then by the job's criteria."""
        name = f"{attempt.name}.bag"
        recorded = posixpath.join(attempt.results, name)
        with attempt.storage.create(recorded) as sink:
            answer = exchange(sink)
            result = engine_result(answer, RESULT)
        spec = attempt.spec
        judgement = judge(result, FaultPolicy(spec.fault_policy), spec.playback.mode)
        judgement = attempt.source.judge(result, judgement)
        judgement, findings = judged_by_criteria(judgement, attempt, recorded, result)
        return Played(judgement, name, answer, findings)

    def programs(self, stack: Stack) -> list[Program]:
        """The stack's command and the master."""
        return [own_program(stack, _SOURCED), Program("rosmaster", "ROS needs", _SOURCED)]

    def by_hand(
        self, case: Case, spec: SimulationJobSpec, source: JobSource, storage: Storage, bag: Path
    ) -> Iterator[str]:
        """Parameters, remaps, and the agent's own player."""
        stack = stack_of(spec, case.conditions)
        yield "Start a rosmaster, set these parameters and remaps, and start the stack:"
        yield f"  parameters {json.dumps(stack.parameters)}"
        yield f"  remaps     {json.dumps(stack.remap)}"
        yield f"  command    {shlex.join(stack.command)}"
        yield "Then play into it (this lists what every node has received):"
        yield f"  {shlex.join(play_command(case, spec, source.begin(case, storage, bag), bag))}"


ENGINE = Ros1()
