"""What was observed of a job, for its status to be decided on. Pure."""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field

from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.driver.ending import Ending
from bagpipe_operator.jobs.driver.progress import Progress
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.pods.refusal import Refusal
from bagpipe_operator.jobs.troubles.trouble import Trouble


@dataclass(frozen=True)
class Halt:
    """Why a job's pods are stopped. `final`: the job fails when they are gone; else it rests."""

    reason: str
    message: str
    final: bool = False

    def while_stopping(self, pods: int) -> str:
        """The message as long as there are pods."""
        left = "1 pod is" if pods == 1 else f"{pods} pods are"
        return f"{self.message} {left} being stopped; what is done is kept."


@dataclass(frozen=True)
class Observation:
    """All that the status of one job depends on."""

    job: JobView
    attempt: int
    driver: PodView | None = None
    executors: tuple[PodView, ...] = ()
    progress: Progress | None = None
    refusal: Refusal | None = None
    troubles: tuple[Trouble, ...] = ()
    seen_for: Mapping[Hashable, float] = field(default_factory=dict)  # seconds, by Trouble.key
    refused_for: float = 0.0  # seconds
    ending: Ending | None = None
    backoff_limit: int = 0
    halt: Halt | None = None
    alive: tuple[PodView, ...] = ()  # of all attempts
    resumed_from: Json | None = None
    baseline: Json | None = None
    kueue: bool = False  # whether jobs wait for their queues

    @property
    def executor_runs(self) -> bool:
        """Whether a case may be running at all."""
        containers = (pod.container(names.CONTAINER_SPARK) for pod in self.executors)
        return any(container is not None and container.running for container in containers)
