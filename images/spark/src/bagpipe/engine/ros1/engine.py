"""How a case of ROS 1 nodes is played, recorded and judged."""

import json
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path

from bagpipe.engine.engine import Attempt, Played, Program, own_program
from bagpipe.engine.replay import replayed
from bagpipe.engine.ros1.by_hand import play_command
from bagpipe.plan.case import Case
from bagpipe.plan.variant import stack_of
from bagpipe.source.source import JobSource, Turns
from bagpipe.spec import SimulationJobSpec, Stack
from bagpipe.storage import Storage
from bagpipe.wire.session import Answer, InputFile, Sink, Sinks

_SOURCED = "put its folder on PATH (such as by sourcing setup.bash)"


class Ros1:
    """stack.engine: ros1."""

    def input(self, source: JobSource, case: Case, storage: Storage) -> InputFile | Turns:
        """What the source has."""
        return source.input(case, storage)

    def play(self, attempt: Attempt, exchange: Callable[[Sink | Sinks], Answer]) -> Played:
        """Keeps the recorded bag; judges delivery first, then by the job's criteria."""
        return replayed(attempt, exchange, ".bag")

    def programs(self, stack: Stack) -> list[Program]:
        """The stack's command, and the master where it is the image's."""
        own = own_program(stack, _SOURCED)
        if stack.ros1 and stack.ros1.master == "image":
            return [own, Program("rosmaster", "stack.ros1.master: image needs", _SOURCED)]
        return [own]

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
