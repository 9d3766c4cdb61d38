"""Cases that are put together of pieces: in a sequence, or beside a simulated drive.

Pieces may hold templates, so each condition of the job has parts of its own.
"""

import dataclasses
from collections.abc import Callable

from bagpipe.pieces import P, SequencePart, filled_pieces
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Crossing
from bagpipe.plan.fragments import Window
from bagpipe.plan.made import Plan, Unplanned
from bagpipe.plan.parts import Part, PartError, PartPlanner, version_of
from bagpipe.plan.simulated import DRIVE, simulated_case
from bagpipe.simulator.model import START, Simulator
from bagpipe.spec import Source
from bagpipe.storage import Storage
from bagpipe.texts import duration_seconds

# The name of the one fragment of a sequence, and what stands in a row in place of a bag's URI.
SEQUENCE = "sequence"
_WHERE = {SEQUENCE: "source.sequence", DRIVE: "source.simulator.recorded"}


def sequences(source: Source, conditions: Crossing, storage: Storage) -> Plan:
    """The pieces of `source.sequence` one after the other, under every condition.

    Raises MatrixError where a template is filled with what makes no piece.
    """
    planner = PartPlanner(storage)
    warm_up = int(duration_seconds(source.fragment.warm_up) * 1e9)

    def parts_of(pieces: list[SequencePart]) -> list[Part]:
        return planner.sequence(pieces, source.topics, warm_up)

    made = _cases(conditions, source.sequence, SEQUENCE, parts_of, _sequence)
    return Plan.of(made.cases, made.unplanned)


def drives(simulator: Simulator, conditions: Crossing, storage: Storage) -> Plan:
    """The simulated drive with its recorded topics, under every condition. Raises MatrixError."""
    planner = PartPlanner(storage)
    length = simulator.steps * simulator.step_nanoseconds
    drive = simulated_case(simulator)

    def beside(parts: list[Part]) -> Case:
        return dataclasses.replace(drive, bag_version=version_of(parts), parts=parts)

    return _cases(
        conditions,
        simulator.recorded,
        DRIVE,
        lambda pieces: planner.beside(pieces, START, length),
        beside,
    )


def _cases(
    conditions: Crossing,
    pieces: list[P],
    name: str,
    parts_of: Callable[[list[P]], list[Part]],
    case_of: Callable[[list[Part]], Case],
) -> Plan:
    cases: list[Case] = []
    unplanned: dict[str, Unplanned] = {}
    planned: dict[str, Case | PartError] = {}
    for suffix, condition in conditions.named:
        filled = filled_pieces(pieces, condition.known, _WHERE[name])
        key = "\n".join(piece.model_dump_json() for piece in filled)
        if key not in planned:
            try:
                planned[key] = case_of(parts_of(filled))
            except PartError as error:
                planned[key] = error
        found = planned[key]
        if isinstance(found, PartError):
            # Once, as a broken bag of source.bags is told once and not for each condition.
            told = Unplanned(name + suffix, found.bag, found.reason, str(found))
            unplanned.setdefault(told.message, told)
        else:
            case = dataclasses.replace(found, id=name + suffix, fragment=name, conditions=condition)
            cases.append(case)
    return Plan(cases, list(unplanned.values()))


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
