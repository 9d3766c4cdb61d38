"""How a waiting driver is handed to a job, so that each job runs on one driver or cold. Pure.

A claim stands in the job's status, written with the job's version: a job claims one driver at most.
The driver has one seat, and looks the claim up before it lets a job sit down: it runs one job at
most. Cold pods are made only when the driver can't run the job any more: it has refused, which it
remembers, or its pod is gone.
"""

from dataclasses import dataclass, replace
from datetime import datetime
from typing import Literal

from bagpipe_operator.jobs.claim import Claim
from bagpipe_operator.jobs.pools.warm import HANDOVER_SECONDS

# What the driver answered, or that its pod is no more.
Received = Literal["taken", "ended", "refused", "silent", "gone"]
# What is to be done: offer the job again, leave the driver to it, delete the driver's pod, make
# pods of the job's own, replace the driver as that of any job, or read how the job ended.
Act = Literal["offer", "run", "delete", "cold", "replace", "read"]


@dataclass(frozen=True)
class Step:
    """What is written, then what is done; without a claim the job has no driver of a pool."""

    claim: Claim | None
    act: Act


def step(claim: Claim, received: Received, now: datetime) -> Step:
    """The next step of a handover.

    A driver that is to be deleted may have taken the job in that moment: it is deleted all the
    same, since its answer may come from before. A claim from the future is of a clock that was
    ahead, by days maybe.
    """
    if received == "ended":
        return Step(replace(claim, state="Taken"), "read")
    if claim.state == "Taken":
        return Step(None, "replace") if received == "gone" else Step(claim, "run")
    if received in {"refused", "gone"}:
        return Step(None, "cold")
    asked_for = abs((now - claim.since).total_seconds())
    late = received == "silent" and asked_for >= HANDOVER_SECONDS
    if claim.state == "Fenced" or late:
        return Step(replace(claim, state="Fenced"), "delete")
    if received == "taken":
        return Step(replace(claim, state="Taken"), "run")
    return Step(claim, "offer")
