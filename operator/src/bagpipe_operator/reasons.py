"""Every reason that a condition or an event of the operator can carry, grouped by cause.

Reasons that come from the driver (BagUnreadable, ...) pass through as they are.
"""

# The way of a job without trouble.
DRIVER_CREATED = "DriverCreated"
DRIVER_PENDING = "DriverPending"
PLANNING = "Planning"
CASES_PLANNED = "CasesPlanned"
EXECUTORS_PENDING = "ExecutorsPending"
CASES_RUNNING = "CasesRunning"
IN_PROGRESS = "InProgress"
JOB_COMPLETE = "JobComplete"
JOB_FAILED = "JobFailed"
JOB_FINISHED = "JobFinished"

# The job's children could not be created.
SPEC_INVALID = "SpecInvalid"
JOB_TOO_LARGE = "JobTooLarge"
NAME_TAKEN = "NameTaken"
SERVICE_ACCOUNT_MISSING = "ServiceAccountMissing"
QUOTA_EXCEEDED = "QuotaExceeded"
CREATION_REFUSED = "CreationRefused"

# A pod does not start.
DRIVER_IMAGE_UNAVAILABLE = "DriverImageUnavailable"
AGENT_IMAGE_UNAVAILABLE = "AgentImageUnavailable"
STACK_IMAGE_UNAVAILABLE = "StackImageUnavailable"
EXECUTOR_IMAGE_UNAVAILABLE = "ExecutorImageUnavailable"
CONTAINER_NOT_STARTING = "ContainerNotStarting"
VOLUME_MISSING = "VolumeMissing"
UNSCHEDULABLE = "Unschedulable"

# A pod ended before its work did.
DRIVER_FAILED = "DriverFailed"
DRIVER_LOST = "DriverLost"
DRIVER_EVICTED = "DriverEvicted"
DRIVER_OUT_OF_MEMORY = "DriverOutOfMemory"
EXECUTOR_OUT_OF_MEMORY = "ExecutorOutOfMemory"
EXECUTOR_EVICTED = "ExecutorEvicted"

# Reasons of Running that deserve a warning when they appear.
TROUBLES = frozenset(
    {
        DRIVER_IMAGE_UNAVAILABLE,
        AGENT_IMAGE_UNAVAILABLE,
        STACK_IMAGE_UNAVAILABLE,
        EXECUTOR_IMAGE_UNAVAILABLE,
        CONTAINER_NOT_STARTING,
        VOLUME_MISSING,
        UNSCHEDULABLE,
        EXECUTOR_OUT_OF_MEMORY,
        EXECUTOR_EVICTED,
    }
)
