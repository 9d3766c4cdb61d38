"""What the API server has refused to create, and when it is asked again.

A refusal is an answer, so the queue's growing pauses do not apply to it; and a quota that is used
up refuses all jobs of a namespace for as long as others run. They share what may be asked as those
do that Lookout looks into.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pods.refusal import Refusal
from bagpipe_operator.jobs.troubles.lookout import LOOK_EVERY_SECONDS
from bagpipe_operator.runtime.fair_share import FairShare


@dataclass(frozen=True)
class _Held:
    what: tuple[int, int]  # another attempt, or a job that was edited, is another question
    since: float
    asked_at: float
    refusal: Refusal


@dataclass
class Refusals:
    """The last refusal of each job that has no driver for it."""

    stuck_seconds: float
    monotonic: Callable[[], float]
    _held: dict[str, _Held] = field(default_factory=dict)
    _share: FairShare = field(default_factory=lambda: FairShare(LOOK_EVERY_SECONDS))

    def standing(self, job: JobView, attempt: int) -> Refusal | None:
        """The last refusal as long as it is not to be asked again.

        Before a lasting one ends its job it is asked once more: it may have been mended meanwhile.
        """
        held = self._held.get(job.uid)
        if held is None or held.what != (attempt, job.generation):
            return None
        now = self.monotonic()
        if held.refusal.lasting and now - held.since >= self.stuck_seconds:
            return None
        too_soon = now - held.asked_at < self._share.seconds(job.namespace)
        return held.refusal if too_soon else None

    def asked(self, uid: str) -> bool:
        """Whether the job was refused before, so that its ConfigMap may be there."""
        return uid in self._held

    def keep(self, job: JobView, attempt: int, refusal: Refusal) -> None:
        """The API server has just refused a pod."""
        now, what = self.monotonic(), (attempt, job.generation)
        held = self._held.get(job.uid)
        same = held is not None and held.what == what and held.refusal.key == refusal.key
        since = held.since if held is not None and same else now
        self._held[job.uid] = _Held(what, since, now, refusal)
        self._share.add(job.uid, job.namespace)

    def forget(self, uid: str) -> None:
        """The job has a driver, or needs none any more."""
        self._held.pop(uid, None)
        self._share.remove(uid)
