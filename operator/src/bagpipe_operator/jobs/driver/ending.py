"""How a job ended, read from its driver's pod. Pure."""

from dataclasses import dataclass
from datetime import datetime

from bagpipe_operator.api import names, reasons
from bagpipe_operator.jobs.driver.progress import Progress, parse
from bagpipe_operator.jobs.pod_view import ContainerView, Disruption, PodView
from bagpipe_operator.jobs.troubles.casualties import EVICTIONS, VOLUNTARY

_AGAIN = "Create the job again."
# What a driver gives as the reason of its last account when it could not go on without Spark.
_SPARK_GONE = "SparkGone"

# The kubelet that should end a deleted pod has the pod's grace period, and this much more.
UNREACHABLE_SECONDS = 15.0


@dataclass(frozen=True)
class Ending:
    """An end of a driver: complete or failed, why, and its last account if it left one.

    `lost` says that the driver's work was cut short from outside, so that another may go on;
    `advice` is for the user whose job ends with it.
    """

    complete: bool
    reason: str
    message: str
    progress: Progress | None = None
    advice: str = ""
    lost: bool = False
    # Kubernetes took the pod for another's sake: no fault of the job's, and not counted.
    voluntary: bool = False

    @property
    def final_message(self) -> str:
        """What happened and what to do, when no other driver takes over."""
        return f"{self.message} {self.advice}".rstrip()


def ending_of(driver: PodView, now: datetime) -> Ending | None:
    """The driver's end, or None as long as its container may still run.

    A pod that should be gone and is not lies on a node that nobody reaches. It may still run
    there; what it writes can't replace what another driver commits.
    """
    container = driver.container(names.CONTAINER_DRIVER)
    code = container.exit_code if container else None
    if container is None or code is None:
        late = overdue(driver, now)
        if driver.ended or (late and driver.disruption is not None):
            return _of_pod(driver)
        return _unreachable(driver) if late else None
    return _of_exit(driver, container, code)


def refused(reason: str, error: Exception) -> Ending:
    """The end of a job that can't be begun."""
    return Ending(False, reason, str(error))


def has_ended(progress: Progress | None, uid: str, attempt: int) -> Ending | None:
    """The end of a job whose driver waits for another one, as that one's account says.

    It must name the job and the attempt: every driver that waits does, and what names none may be
    another pod's that has the driver's address by now.
    """
    if progress is None or not progress.ended or progress.phase != "Complete":
        return None
    return _completed(progress) if progress.is_of(uid, attempt) else None


def _completed(progress: Progress) -> Ending:
    reason = progress.reason or reasons.JOB_COMPLETE
    return Ending(True, reason, progress.message or "All cases ran.", progress)


def _of_exit(driver: PodView, container: ContainerView, code: int) -> Ending:
    progress = parse(container.message) if container.message else None
    if progress is not None and not progress.is_of(driver.job_uid, driver.attempt):
        progress = None  # of the job that the driver had before
    if code == 0 and progress is not None and progress.phase == "Complete":
        return _completed(progress)
    if progress is not None and progress.phase == "Failed" and not _crashed(container, progress):
        return Ending(
            False,
            progress.reason or reasons.DRIVER_FAILED,
            progress.message or f"The driver ended with exit status {code}.",
            progress,
        )
    return _without_account(driver, container, code, progress)


def _crashed(container: ContainerView, progress: Progress) -> bool:
    """Whether the account shows only the lack of memory: the kernel ended Spark's JVM."""
    return container.reason == "OOMKilled" and progress.reason == reasons.DRIVER_FAILED


def _without_account(
    driver: PodView, container: ContainerView, code: int, progress: Progress | None
) -> Ending:
    if container.reason == "OOMKilled":
        return Ending(
            False,
            reasons.DRIVER_OUT_OF_MEMORY,
            f"The driver's pod {driver.name} was ended for lack of memory.",
            progress,
            "Raise spec.spark.driver.resources.memory and create the job again.",
            lost=True,
        )
    if driver.reason == "Evicted" or driver.disruption is not None:
        return _of_pod(driver)
    if driver.deleting:
        return Ending(
            False,
            reasons.DRIVER_LOST,
            f"The driver's pod {driver.name} was deleted before its job ended.",
            progress,
            _AGAIN,
            lost=True,
        )
    log = f"Read its log: kubectl logs -n {driver.namespace} {driver.name}"
    if progress is not None and progress.reason == _SPARK_GONE:
        return Ending(
            False,
            reasons.DRIVER_FAILED,
            f"The driver's pod {driver.name} ended before its job did: {progress.message}.",
            progress,
            log,
            lost=True,
        )
    account = (
        f"although its last account says {progress.phase}"
        if progress
        else "and without an account of its cases"
    )
    return Ending(
        False,
        reasons.DRIVER_FAILED,
        f"The driver's pod {driver.name} ended with exit status {code} {account}.",
        progress,
        log,
        lost=True,
    )


def _of_pod(driver: PodView) -> Ending:
    """A pod that the node ended as a whole: evicted, or lost with its node."""
    text = f" {driver.message}" if driver.message else ""
    if driver.disruption is not None:
        return _disrupted(driver, driver.disruption)
    if driver.reason == "Evicted":
        return Ending(
            False,
            reasons.DRIVER_EVICTED,
            f"The driver's pod {driver.name} was evicted.{text}",
            advice=_AGAIN,
            lost=True,
        )
    return Ending(
        False,
        reasons.DRIVER_LOST,
        f"The driver's pod {driver.name} ended as {driver.phase} ({driver.reason or 'no reason'})."
        f"{text}",
        advice=_AGAIN,
        lost=True,
    )


def _disrupted(driver: PodView, disruption: Disruption) -> Ending:
    by = EVICTIONS.get(disruption.reason)
    what = f"was evicted {by}" if by else f"was taken away ({disruption.reason})"
    text = f" {driver.message or disruption.message}".rstrip()
    return Ending(
        False,
        reasons.DRIVER_EVICTED if by else reasons.DRIVER_LOST,
        f"The driver's pod {driver.name} {what}.{text}",
        advice=_AGAIN,
        lost=True,
        voluntary=disruption.reason in VOLUNTARY,
    )


def overdue(pod: PodView, now: datetime) -> bool:
    """Whether a deleted pod should be gone by now: its node can't be reached."""
    if pod.gone_by is None:
        return False
    return (now - pod.gone_by).total_seconds() > UNREACHABLE_SECONDS


def _unreachable(driver: PodView) -> Ending:
    return Ending(
        False,
        reasons.DRIVER_LOST,
        f"The driver's pod {driver.name} was deleted and its node does not say that it has ended.",
        advice=_AGAIN,
        lost=True,
    )


def lost_driver(namespace: str, name: str, went: PodView | None = None) -> Ending:
    """The end of a driver whose pod is not there any more; `went` is how it was seen to go.

    One that had ended before it was deleted has left its account.
    """
    container = went.container(names.CONTAINER_DRIVER) if went is not None else None
    if went is not None and container is not None and container.exit_code is not None:
        return _of_exit(went, container, container.exit_code)
    if went is not None and went.disruption is not None:
        return _disrupted(went, went.disruption)
    return Ending(
        False,
        reasons.DRIVER_LOST,
        f"The driver's pod {name} was deleted in namespace {namespace} before its job ended.",
        advice=_AGAIN,
        lost=True,
    )
