"""Jobs as they are offered to a driver that waits."""

from bagpipe.driver.seat import Offer
from bagpipe.spec import JobFile


def offer_of(job: JobFile, digest: str = "digest", sender: str = "") -> Offer:
    """What the operator offers, or whoever."""
    return Offer(job.namespace, job.name, job.uid, job.attempt, digest, lambda: job, sender)
