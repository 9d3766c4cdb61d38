"""Jobs for tests: valid defaults, changed where a test says so."""

from typing import Any

from bagpipe.spec import JobFile, SimulationJobSpec


def make_spec(**changed: Any) -> SimulationJobSpec:
    """A spec with the given top-level fields replaced."""
    fields: dict[str, Any] = {
        "source": {"bags": ["pvc://recordings/*.bag"], "topics": ["/scan"]},
        "stack": {"image": "stack:1", "command": ["run"]},
        "record": {"topics": ["/out"]},
        "output": {"uri": "pvc://results/out"},
    }
    return SimulationJobSpec.model_validate(fields | changed)


def make_job(volumes: dict[str, str], **changed: Any) -> JobFile:
    """A job file around `make_spec(**changed)`."""
    return JobFile(
        name="drive",
        namespace="lab",
        uid="uid-1",
        attempt=1,
        spec=make_spec(**changed),
        images={"spark": "spark:1", "agent": "agent:1"},  # type: ignore[arg-type]
        volumes=volumes,
    )
