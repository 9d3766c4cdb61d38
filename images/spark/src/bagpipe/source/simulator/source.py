"""A simulated drive in place of a recording, with recorded topics beside it."""

from typing import Any

from bagpipe.judgement import Judgement
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Crossing
from bagpipe.plan.made import Plan
from bagpipe.simulator.model import Simulator
from bagpipe.source.simulator.planning import check_scenarios, drives
from bagpipe.source.simulator.steering import judge_steering
from bagpipe.source.source import JobSource, Turns
from bagpipe.storage import Storage


class Simulated(JobSource):
    """source.simulator: a world that answers the stack."""

    @property
    def simulator(self) -> Simulator:
        """As it is written."""
        simulator: Simulator = self.spec.source.own
        return simulator

    def plan(self, conditions: Crossing, storage: Storage) -> Plan:
        """One drive under every condition. Raises MatrixError."""
        check_scenarios(self.simulator, conditions)
        return drives(self.simulator, self.encoding, conditions, storage)

    def input(self, case: Case, storage: Storage) -> Turns:
        """The case's world."""
        from bagpipe.source.simulator.drive import Drive  # noqa: PLC0415

        return Drive(case, self.spec, self.simulator, storage)

    def file_name(self, case: Case) -> str:
        """A drive is no file; this is what stands for one."""
        return case.bag

    def input_times(self, _case: Case, _storage: Storage) -> None:
        """A simulator is never silent."""
        return

    def truth(self, case: Case, _topics: set[str], storage: Storage) -> bytes:
        """The recorded topics beside the drive."""
        from bagpipe.source.sequence.stream import sequence  # noqa: PLC0415

        return bytes(sequence(case, storage, self.encoding))

    def judge(self, result: dict[str, Any], judgement: Judgement) -> Judgement:
        """A drive that nobody steered proves nothing."""
        return judge_steering(result, judgement, self.simulator.topics.control)


SOURCE = Simulated
