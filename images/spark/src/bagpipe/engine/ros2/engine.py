"""How a case of ROS 2 nodes is played, recorded and judged."""

import json
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path

from bagpipe.engine.engine import Attempt, Played, Program, own_program
from bagpipe.engine.replay import replayed
from bagpipe.engine.ros2.by_hand import play_command
from bagpipe.engine.ros2.proof import PROOF
from bagpipe.engine.ros2.sourced import LIBRARY, is_sourced
from bagpipe.plan.case import Case
from bagpipe.plan.variant import stack_of
from bagpipe.source.source import JobSource, Turns
from bagpipe.spec import SimulationJobSpec, Stack
from bagpipe.storage import Storage
from bagpipe.wire.session import Answer, InputFile, Sink, Sinks

_SETUP = (
    "source its setup.bash, which sets AMENT_PREFIX_PATH, or write stack.ros2.player: dds where the"
    " stack has ROS 2 linked statically"
)


class Ros2:
    """stack.engine: ros2."""

    def input(self, source: JobSource, case: Case, storage: Storage) -> InputFile | Turns:
        """What the source has."""
        return source.input(case, storage)

    def play(self, attempt: Attempt, exchange: Callable[[Sink | Sinks], Answer]) -> Played:
        """Keeps the recorded MCAP; judges delivery and its proof first, then by the criteria."""
        return replayed(attempt, exchange, ".mcap", PROOF)

    def programs(self, stack: Stack) -> list[Program]:
        """The stack's command, and the library by which messages are played, if one is."""
        own = own_program(stack, "put its folder on PATH (such as by sourcing setup.bash)")
        if stack.ros2 and stack.ros2.player == "dds":
            return [own]
        return [own, Program(LIBRARY, "stack.engine: ros2 plays by a ROS 2's", _SETUP, is_sourced)]

    def by_hand(
        self, case: Case, spec: SimulationJobSpec, source: JobSource, storage: Storage, bag: Path
    ) -> Iterator[str]:
        """Parameters, and ROS 2's own player, which proves nothing."""
        stack = stack_of(spec, case.conditions)
        begin = source.begin(case, storage, bag)
        yield "Start the stack with these parameters:"
        yield f"  parameters {json.dumps(stack.parameters)}"
        yield f"  command    {shlex.join(stack.command)}"
        yield "Then play into it (this says nothing of what was lost):"
        yield f"  {shlex.join(play_command(case, spec, stack, begin, bag))}"


ENGINE = Ros2()
