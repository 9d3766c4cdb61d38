"""Why a run of a case does not pass, in Bagpipe's own words."""

from bagpipe.faults import CAUSES

REASONS = frozenset(
    set(CAUSES)
    | {"AgentDied", "ProtocolError", "RosMasterFailed", "SlotUnavailable", "StorageFailed"}
    | {"BagCut", "BagEmpty", "BagMissing", "BagNotIndexed", "BagUnreadable", "FileMissing"}
    | {"CriteriaFailed", "CriterionFailed", "NoMatchingTopics", "NotEnoughEvidence"}
    | {"NothingPlayed", "NothingRecorded", "ProgramFailed", "ProgramInvalid", "UnknownOutcome"}
    | {"ExecutorLost", "Internal", "RecorderBudgetExceeded", "StackProtocolError"}
    | {"CommandNotFound", "MachineBusy", "OutOfMemoryOnce", "StackAborted", "StorageFull"}
)
