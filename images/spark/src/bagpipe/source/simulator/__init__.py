"""A simulated drive in place of a recording, with recorded topics beside it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bagpipe
from bagpipe.judgement import Judgement
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Crossing
from bagpipe.plan.made import Plan
from bagpipe.simulator.model import Simulator
from bagpipe.source.sequence.stream import sequence_bag
from bagpipe.source.simulator.drive import Drive, judge_steering
from bagpipe.source.simulator.planning import check_scenarios, drives
from bagpipe.spec import SimulationJobSpec, Source
from bagpipe.storage import Storage


@dataclass(frozen=True)
class Simulated:
    """source.simulator: a world that answers the stack."""

    spec: SimulationJobSpec
    simulator: Simulator

    def plan(self, conditions: Crossing, storage: Storage) -> Plan:
        """One drive under every condition. Raises MatrixError."""
        check_scenarios(self.simulator, conditions)
        return drives(self.simulator, conditions, storage)

    def input(self, case: Case, storage: Storage) -> Drive:
        """The case's world."""
        return Drive(case, self.spec, self.simulator, storage)

    def file_name(self, case: Case) -> str:
        """A drive is no file; this is what stands for one."""
        return case.bag

    def input_times(self, _case: Case, _storage: Storage) -> None:
        """A simulator is never silent."""
        return

    def truth(self, case: Case, _topics: set[str], storage: Storage) -> bytes:
        """The recorded topics beside the drive."""
        return sequence_bag(case, storage).to_bytes()

    def judge(self, result: dict[str, Any], judgement: Judgement) -> Judgement:
        """A drive that nobody steered proves nothing."""
        return judge_steering(result, judgement, self.simulator.topics.control)

    def alone(self, _uri: str) -> Source | None:
        """A drive is no recording."""
        return None

    def begin(self, _case: Case, _storage: Storage, written: Path) -> int:
        """Told by what was written."""
        return bagpipe.MemoryBag.open(written).start or 0
