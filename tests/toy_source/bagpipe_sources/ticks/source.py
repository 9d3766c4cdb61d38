"""One case of ticks, and the bag that it is played from."""

import struct
from collections.abc import Callable
from typing import Any

import bagpipe
from bagpipe.judgement import Judgement
from bagpipe.plan.case import Case, crossed
from bagpipe.plan.conditions import Crossing
from bagpipe.plan.fragments import Window
from bagpipe.plan.made import Plan
from bagpipe.source.source import JobSource
from bagpipe.source_spec import Source
from bagpipe.storage import Storage
from bagpipe.texts import duration_nanoseconds
from bagpipe.wire.frames import MAX_PAYLOAD_BYTES
from bagpipe.wire.session import InputFile

_BEGIN = 1_000_000_000
_MD5_OF_UINT32 = "304a39449588c7f8ce2df6e8001c5fce"


class Counter(JobSource):
    """source.ticks: made for each case, of nothing that is stored."""

    def plan(self, conditions: Crossing, _storage: Storage) -> Plan:
        """The ticks under every condition."""
        times = self._times()
        window = Window(_BEGIN, _BEGIN, times[-1] + 1)
        case = Case("ticks", "ticks", "", window, [], [], messages=len(times))
        return Plan.of(crossed([case], conditions), [])

    def input(self, case: Case, _storage: Storage) -> InputFile:
        """The ticks as a bag."""
        bag = self._bag()
        pieces = range(0, len(bag), MAX_PAYLOAD_BYTES)
        return InputFile(
            self.file_name(case), len(bag), [],
            lambda: (bag[at : at + MAX_PAYLOAD_BYTES] for at in pieces),
        )  # fmt: skip

    def file_name(self, _case: Case) -> str:
        """A bag's name."""
        return "ticks.bag"

    def input_times(self, _case: Case, _storage: Storage) -> Callable[[], list[int]]:
        """When each is played."""
        return self._times

    def truth(self, _case: Case, _topics: set[str], _storage: Storage) -> bytes:
        """The ticks."""
        return self._bag()

    def judge(self, result: dict[str, Any], judgement: Judgement) -> Judgement:
        """As many messages must be recorded as there are ticks."""
        recorded, count = result["recorded"]["messages"], self.spec.source.own.count
        if judgement.outcome != "passed" or recorded >= count:
            return judgement
        return Judgement("failed", "TicksMissing", f"{recorded} messages for {count} ticks")

    def alone(self, _uri: str) -> Source:
        """They are the same at each replay."""
        return self.spec.source

    def _times(self) -> list[int]:
        ticks = self.spec.source.own
        step = duration_nanoseconds(ticks.every)
        return [_BEGIN + number * step for number in range(ticks.count)]

    def _bag(self) -> bytes:
        writer = bagpipe.MemoryBag.writer()
        for number, time in enumerate(self._times()):
            writer.write(
                self.spec.source.own.topic, time, struct.pack("<I", number),
                type="std_msgs/UInt32", md5sum=_MD5_OF_UINT32, definition="uint32 data\n",
            )  # fmt: skip
        return writer.finish().to_bytes()


SOURCE = Counter
