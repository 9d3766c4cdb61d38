"""What an end or a loss of the stack means for its case: spec.faultPolicy, by cause."""

from typing import Literal, Self, get_args

from pydantic import BaseModel, Field, model_validator

from bagpipe.pod_spec import SPEC_CONFIG

Cause = Literal[
    "StackCrashed",
    "StackExited",
    "StackOutOfMemory",
    "NodeGone",
    "NodeRespawned",
    "MessagesLost",
    "DeliveryUnproved",
    "NeverSubscribed",
    "NodeInactive",
    "StackNeverExited",
    "StackStoppedReading",
    "CaseDeadlineExceeded",
]
Action = Literal["fail", "retry", "allow"]

CAUSES: tuple[str, ...] = get_args(Cause)
_SEEN = frozenset({"StackCrashed", "StackExited", "NodeGone", "NodeRespawned", "MessagesLost"})
# What leaves a run that can still be judged; after the others there is nothing to judge.
ALLOWABLE = _SEEN | {"DeliveryUnproved"}
# A case that ends so was run: the stack failed it.
FAILURES = _SEEN | {"StackOutOfMemory", "StackStoppedReading", "NodeInactive"}


class FaultRule(BaseModel):
    """What one cause means; causes without a rule fail the case."""

    model_config = SPEC_CONFIG

    cause: Cause
    action: Action
    retries: int | None = Field(default=None, ge=1, le=20)

    @model_validator(mode="after")
    def _fits_the_action(self) -> Self:
        if self.retries is not None and self.action != "retry":
            raise ValueError(
                f"faultPolicy[{self.cause}].retries has no meaning with action: {self.action}:"
                " leave it out, or write action: retry"
            )
        if self.action == "allow" and self.cause not in ALLOWABLE:
            raise ValueError(
                f"faultPolicy[{self.cause}] can't be allowed, since no result is left to judge:"
                " write action: fail or retry"
            )
        return self


class FaultPolicy:
    """The rules of a job."""

    def __init__(self, rules: list[FaultRule]) -> None:
        self._rules: dict[str, FaultRule] = {rule.cause: rule for rule in rules}

    def allows(self, cause: str) -> bool:
        """Whether a run of this cause is judged as if nothing had happened."""
        rule = self._rules.get(cause)
        return rule is not None and rule.action == "allow"

    def retries(self, cause: str) -> int:
        """How often a case is run again after this cause."""
        rule = self._rules.get(cause)
        return (rule.retries or 1) if rule is not None and rule.action == "retry" else 0

    @property
    def allowed(self) -> list[str]:
        """The causes that are allowed."""
        return sorted(cause for cause, rule in self._rules.items() if rule.action == "allow")
