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

# Whether an ended job passed; where it failed, Passed has the reason of Failed.
NOT_ENDED = "NotEnded"
PASSED = "Passed"
REGRESSED = "Regressed"
NO_VERDICT = "NoVerdict"

# Whether receivers were notified of a job's end.
RECEIVER_UNKNOWN = "ReceiverUnknown"
NOTIFYING = "Notifying"
NOTIFIED = "Notified"
NOTIFICATION_LOST = "NotificationLost"

# Stopped and going on again.
NOT_SUSPENDED = "NotSuspended"
SUSPENDING = "Suspending"
JOB_SUSPENDED = "JobSuspended"
JOB_RESUMED = "JobResumed"
QUEUED = "Queued"
QUEUE_REFUSED = "QueueRefused"
ADMITTED = "Admitted"
# Of a job that is suspended no more.
GOES_ON = frozenset({JOB_RESUMED, ADMITTED})
DEADLINE_EXCEEDED = "DeadlineExceeded"
START_DEADLINE_EXCEEDED = "StartDeadlineExceeded"
JOB_DELETED = "JobDeleted"
RESUME_REFUSED = "ResumeRefused"

# What spec.baseline.lastPassed is.
LAST_PASSED = "LastPassed"
NO_BASELINE_YET = "NoBaselineYet"
BASELINE_REFUSED = "BaselineRefused"

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
SECRET_MISSING = "SecretMissing"  # noqa: S105 - a reason, not a secret
CONFIG_MAP_MISSING = "ConfigMapMissing"
VOLUME_MISSING = "VolumeMissing"
VOLUME_PENDING = "VolumePending"
VOLUME_NOT_MOUNTED = "VolumeNotMounted"
EXECUTORS_REFUSED = "ExecutorsRefused"
UNSCHEDULABLE = "Unschedulable"

# A pod ended before its work did.
DRIVER_FAILED = "DriverFailed"
DRIVER_LOST = "DriverLost"
DRIVER_EVICTED = "DriverEvicted"
DRIVER_OUT_OF_MEMORY = "DriverOutOfMemory"
EXECUTOR_OUT_OF_MEMORY = "ExecutorOutOfMemory"
EXECUTOR_EVICTED = "ExecutorEvicted"
NODE_LOST = "NodeLost"

# The ends of a driver that another one takes over from.
DRIVER_ENDS = frozenset({DRIVER_FAILED, DRIVER_LOST, DRIVER_EVICTED, DRIVER_OUT_OF_MEMORY})

# A schedule and its runs.
SCHEDULED = "Scheduled"
SUSPENDED_BY_SPEC = "SuspendedBySpec"
NOT_SUSPENDED = "NotSuspended"
INVALID_SCHEDULE = "InvalidSchedule"
UNKNOWN_TIME_ZONE = "UnknownTimeZone"
NO_RUN_YET = "NoRunYet"
JOB_STARTED = "JobStarted"
JOB_REPLACED = "JobReplaced"
JOB_ACTIVE = "JobActive"
MISSED_START = "MissedStart"
TOO_MANY_MISSED_STARTS = "TooManyMissedStarts"

# Reasons of Running that deserve a warning when they appear.
TROUBLES = frozenset(
    {
        DRIVER_IMAGE_UNAVAILABLE,
        AGENT_IMAGE_UNAVAILABLE,
        STACK_IMAGE_UNAVAILABLE,
        EXECUTOR_IMAGE_UNAVAILABLE,
        CONTAINER_NOT_STARTING,
        SECRET_MISSING,
        CONFIG_MAP_MISSING,
        VOLUME_MISSING,
        VOLUME_PENDING,
        VOLUME_NOT_MOUNTED,
        QUOTA_EXCEEDED,
        EXECUTORS_REFUSED,
        UNSCHEDULABLE,
        DRIVER_FAILED,
        DRIVER_LOST,
        DRIVER_EVICTED,
        DRIVER_OUT_OF_MEMORY,
        EXECUTOR_OUT_OF_MEMORY,
        EXECUTOR_EVICTED,
        NODE_LOST,
    }
)
