"""The object of the source that a job names, in its folder's module `source`."""

from bagpipe.source.source import JobSource
from bagpipe.source_fields import of_source
from bagpipe.spec import SimulationJobSpec


def source_of(spec: SimulationJobSpec) -> JobSource:
    """The source that the job names; its spec has exactly one. Raises InstallationError."""
    made: JobSource = of_source(spec.source.kind, "source")(spec)
    return made
