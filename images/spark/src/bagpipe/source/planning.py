"""The cases of a job: what its source holds, crossed with the matrix and the variants."""

from bagpipe.plan.conditions import crossing
from bagpipe.plan.made import Plan
from bagpipe.plan.variant import check_templates
from bagpipe.source.chosen import source_of
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage


def plan(spec: SimulationJobSpec, storage: Storage) -> Plan:
    """The cases, and what yields none.

    Never raises for a bag's fault; raises MatrixError for the matrix' and the variants' own.
    """
    conditions = crossing(spec)
    check_templates(spec, conditions)
    return source_of(spec).plan(conditions, storage)
