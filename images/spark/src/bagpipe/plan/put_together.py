"""Cases that are put together of pieces: in a sequence, or beside a simulated drive.

Pieces may hold templates, so each condition of the job has parts of its own.
"""

import dataclasses
from collections.abc import Callable

from bagpipe.pieces import P, filled_pieces
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Crossing
from bagpipe.plan.made import Plan, Unplanned
from bagpipe.plan.part import Part
from bagpipe.plan.parts import PartError


def put_together(
    conditions: Crossing,
    pieces: list[P],
    name: str,
    where: str,
    parts_of: Callable[[list[P]], list[Part]],
    case_of: Callable[[list[Part]], Case],
) -> Plan:
    """A case of pieces under every condition. `where` is the pieces' place in the spec.

    Raises MatrixError where a template is filled with what makes no piece.
    """
    cases: list[Case] = []
    unplanned: list[Unplanned] = []
    planned: dict[str, Case | PartError] = {}
    for suffix, condition in conditions.named:
        filled = filled_pieces(pieces, condition.known, where)
        key = "\n".join(piece.model_dump_json() for piece in filled)
        if key not in planned:
            try:
                planned[key] = case_of(parts_of(filled))
            except PartError as error:
                planned[key] = error
        found = planned[key]
        if isinstance(found, PartError):
            # Each under its own name: a quarantine of one must not stand for all.
            unplanned.append(Unplanned(name + suffix, found.bag, found.reason, str(found)))
        else:
            case = dataclasses.replace(found, id=name + suffix, fragment=name, conditions=condition)
            cases.append(case)
    return Plan(cases, unplanned)
