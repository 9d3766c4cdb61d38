"""The one place that asks which source a job has."""

from bagpipe.source.bags import Bags
from bagpipe.source.files import Files
from bagpipe.source.sequence import Sequence
from bagpipe.source.simulator import Simulated
from bagpipe.source.source import JobSource
from bagpipe.spec import SimulationJobSpec


def source_of(spec: SimulationJobSpec) -> JobSource:
    """The source that the job names; its spec has exactly one."""
    if spec.source.simulator is not None:
        return Simulated(spec, spec.source.simulator)
    if spec.source.sequence:
        return Sequence(spec.source)
    if spec.source.files:
        return Files(spec.source)
    return Bags(spec.source)
