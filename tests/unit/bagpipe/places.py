"""Where a driver's cases run in tests."""

from collections.abc import Callable

from bagpipe.driver.job import Place
from bagpipe.driver.keep import Keeper
from bagpipe.plan.case import Case
from bagpipe.spec import JobFile


class By(Place):
    """By a function."""

    def __init__(self, run: Callable[[list[Case], Keeper], None]) -> None:
        super().__init__()
        self._run = run

    def run_cases(self, job: JobFile, cases: list[Case], keeper: Keeper) -> None:  # noqa: ARG002  the base class's signature
        self._run(cases, keeper)


def nothing(cases: list[Case], keeper: Keeper) -> None:  # noqa: ARG001  as any
    """No case is to run."""
    raise AssertionError([case.id for case in cases])
