"""How a job ended, read from its driver's pod. Pure."""

from dataclasses import dataclass

from bagpipe_operator import names, reasons
from bagpipe_operator.progress import Progress, parse
from bagpipe_operator.view import ContainerView, PodView


@dataclass(frozen=True)
class Ending:
    """A job's end: complete or failed, why, and the driver's last account if it left one."""

    complete: bool
    reason: str
    message: str
    progress: Progress | None = None


def ending_of(driver: PodView) -> Ending | None:
    """The job's end, or None as long as the driver's container may still run."""
    container = driver.container(names.CONTAINER_DRIVER)
    code = container.exit_code if container else None
    if container is None or code is None:
        return _of_pod(driver) if driver.ended else None
    progress = parse(container.message) if container.message else None
    if code == 0 and progress is not None and progress.phase == "Complete":
        return Ending(
            True,
            progress.reason or reasons.JOB_COMPLETE,
            progress.message or "All cases ran.",
            progress,
        )
    if progress is not None and progress.phase == "Failed":
        return Ending(
            False,
            progress.reason or reasons.DRIVER_FAILED,
            progress.message or f"The driver ended with exit status {code}.",
            progress,
        )
    return _without_account(driver, container, code, progress)


def _without_account(
    driver: PodView, container: ContainerView, code: int, progress: Progress | None
) -> Ending:
    if container.reason == "OOMKilled":
        return Ending(
            False,
            reasons.DRIVER_OUT_OF_MEMORY,
            f"The driver's pod {driver.name} was ended for lack of memory. "
            "Raise spec.spark.driver.resources.memory and create the job again.",
            progress,
        )
    if driver.reason == "Evicted":
        return _of_pod(driver)
    if driver.deleting:
        return Ending(
            False,
            reasons.DRIVER_LOST,
            f"The driver's pod {driver.name} was deleted before its job ended. "
            "Create the job again.",
            progress,
        )
    account = (
        f"although its last account says {progress.phase}"
        if progress
        else "and without an account of its cases"
    )
    return Ending(
        False,
        reasons.DRIVER_FAILED,
        f"The driver's pod {driver.name} ended with exit status {code} {account}. "
        f"Read its log: kubectl logs -n {driver.namespace} {driver.name}",
        progress,
    )


def _of_pod(driver: PodView) -> Ending:
    """A pod that the node ended as a whole: evicted, or lost with its node."""
    said = f" {driver.message}" if driver.message else ""
    if driver.reason == "Evicted":
        return Ending(
            False,
            reasons.DRIVER_EVICTED,
            f"The driver's pod {driver.name} was evicted.{said} Create the job again.",
        )
    return Ending(
        False,
        reasons.DRIVER_LOST,
        f"The driver's pod {driver.name} ended as {driver.phase} ({driver.reason or 'no reason'})."
        f"{said} Create the job again.",
    )
