"""What every source can do. One object for each job, and as small as its spec.

What planning does not need is imported where it is used: `bagpipe plan` waits for no numpy.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import bagpipe
from bagpipe.encodings import ROS1
from bagpipe.engine_fields import fields_of
from bagpipe.judgement import Judgement
from bagpipe.native import native
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Crossing
from bagpipe.plan.made import Plan
from bagpipe.source_spec import Source
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from bagpipe.wire.hello_case import HelloSimulator
from bagpipe.wire.session import InputFile, Partner

if TYPE_CHECKING:
    from bagpipe.evaluate.evidence import InputStamps

# Of a case's input, in memory and uncompressed.
_MOST_BYTES = 1 << 30


class Turns(Partner, Protocol):
    """A partner that makes a case's input while the stack answers it."""

    @property
    def described(self) -> HelloSimulator:
        """What HELLO says of it, as `simulator`."""


@dataclass(frozen=True)
class JobSource(ABC):
    """The source of one job, made of its spec."""

    spec: SimulationJobSpec

    @property
    def encoding(self) -> str:
        """Of the messages of recordings that are read here; a program takes bags of ROS 1."""
        return fields_of(self.spec.stack.engine).encoding or ROS1

    @abstractmethod
    def plan(self, conditions: Crossing, storage: Storage, /) -> Plan:
        """All cases. Never raises for a recording's fault; raises MatrixError."""

    @abstractmethod
    def input(self, case: Case, storage: Storage, /) -> InputFile | Turns:
        """What the agent is sent. Raises SessionError and StorageError."""

    @abstractmethod
    def file_name(self, case: Case, /) -> str:
        """The plain name of the case's input as a file."""

    @abstractmethod
    def input_times(self, case: Case, storage: Storage, /) -> Callable[[], list[int]] | None:
        """When the case's inputs were recorded: ascending, in ns, in its window.

        None where no time is without an input. The call raises StorageError and BagError.
        """

    def input_stamps(self, _case: Case, _storage: Storage, /) -> "InputStamps | None":
        """When inputs of a part of the case were recorded, and the stamps of their headers.

        None where no few reads show them. The call raises StorageError alone, and answers with
        nothing for a recording that it can't read.
        """
        return None

    @abstractmethod
    def truth(self, case: Case, topics: set[str], storage: Storage, /) -> bytes:
        """The part of the case's own recording that holds these topics, as a bag without an index.

        It may hold more. Raises StorageError, BagError and SessionError.
        """

    def judge(self, _result: dict[str, Any], judgement: Judgement, /) -> Judgement:
        """The judgement on a played case, if the source has nothing to say to it the same."""
        return judgement

    def alone(self, _uri: str, /) -> Source | None:
        """The spec's source with one recording alone; None where none could be played again."""
        return None

    def begin(self, _case: Case, _storage: Storage, written: Path, /) -> int:
        """The time of the first message of the case's input, which was written to a file, in ns.

        0 without one.
        """
        if native("recording_kind", "reading a recording")(written) == "bag":
            return bagpipe.MemoryBag.open(written).start or 0
        described = native("describe_recording", "reading MCAP")(written, _MOST_BYTES)
        return int(described["times"][0]) if described["times"] else 0
