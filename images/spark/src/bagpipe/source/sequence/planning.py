"""The cases of a sequence: its pieces one after the other, under every condition."""

from bagpipe.pieces import SequencePart
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Crossing
from bagpipe.plan.fragments import Window
from bagpipe.plan.made import Plan
from bagpipe.plan.part import Part
from bagpipe.plan.parts import PartPlanner, version_of
from bagpipe.plan.put_together import put_together
from bagpipe.source_spec import Source
from bagpipe.storage import Storage
from bagpipe.texts import duration_nanoseconds

# The name of the one fragment of a sequence, and what stands in a row in place of a bag's URI.
SEQUENCE = "sequence"


def sequences(source: Source, encoding: str, conditions: Crossing, storage: Storage) -> Plan:
    """The pieces of `source.sequence` one after the other, under every condition.

    All have messages of one encoding.
    Raises MatrixError where a template is filled with what makes no piece.
    """
    planner = PartPlanner(storage, encoding)
    warm_up = duration_nanoseconds(source.fragment.warm_up)

    def parts_of(pieces: list[SequencePart]) -> list[Part]:
        return planner.sequence(pieces, source.topics, warm_up)

    made = put_together(conditions, source.own, SEQUENCE, "source.sequence", parts_of, _sequence)
    return Plan.of(made.cases, made.unplanned)


def _sequence(parts: list[Part]) -> Case:
    first, last = parts[0], parts[-1]
    return Case(
        id=SEQUENCE,
        bag=SEQUENCE,
        bag_version=version_of(parts),
        window=Window(first.window.lead_in_start, first.at, last.end),
        connections=[],
        ranges=[],
        messages=sum(part.messages for part in parts),
        parts=parts,
    )
