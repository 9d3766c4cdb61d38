"""How many executors a job has: a number, or the least and the most that it may have.

The operator looks at it as well, in specs of which it keeps only little.
"""

import math
from typing import Annotated, Self

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    model_validator,
)

from bagpipe.pod_spec import SPEC_CONFIG

MOST_EXECUTORS = 1000


def _no_other_type(value: object) -> object:
    """Without it "4" and true would be numbers, which they are not to the API server."""
    if isinstance(value, bool | str):
        raise ValueError("write how many executors, such as 4, or {min: 1, max: 4}")  # noqa: TRY004
    return value


_Count = Annotated[int, Field(ge=1, le=MOST_EXECUTORS), BeforeValidator(_no_other_type)]


class ExecutorRange(BaseModel):
    """`spark.executors` of a job whose executors come and go with what it has to do."""

    # The API server takes this field as a whole: what it would prune elsewhere is refused here.
    model_config = SPEC_CONFIG | ConfigDict(extra="forbid")

    min: _Count
    max: _Count

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.min > self.max:
            raise ValueError(
                f"spark.executors has min {self.min} and max {self.max}: write a max that is at"
                " least min"
            )
        return self


def _form(value: object) -> str:
    return "range" if isinstance(value, dict | ExecutorRange) else "number"


# Which of both is meant is plain, so that a refusal speaks of that one alone.
Executors = Annotated[
    Annotated[_Count, Tag("number")] | Annotated[ExecutorRange, Tag("range")], Discriminator(_form)
]


def least_of(executors: int | ExecutorRange) -> int:
    """How many a job has while it has any case to run."""
    return executors.min if isinstance(executors, ExecutorRange) else executors


def most_of(executors: int | ExecutorRange) -> int:
    """How many a job has at most: what quotas must have room for."""
    return executors.max if isinstance(executors, ExecutorRange) else executors


def wanted(least: int, most: int, slots: int, cases: int) -> int:
    """How many executors so many cases keep busy that run or wait, as Spark reckons it."""
    return min(most, max(least, math.ceil(cases / slots)))
