"""The cases of the bench of fleets, which do nothing: what executors load of it."""

import os
import time

from bagpipe.plan.case import Case
from bagpipe.plan.fragments import Window
from bagpipe.run.case_run import Row, RunContext

# The name of a case in a row that is made once for all.
PLACE = "drive-0000-0000"
SECONDS = "FLEET_CASE_SECONDS"


def row_of(case: str) -> Row:
    """Of a case that passed."""
    return {
        "case": case, "bag": "s3://fleet/0.bag", "window": [0, 1, 2], "outcome": "passed",
        "reason": "", "message": "", "stderr": [], "attempts": 1, "recorded": None, "result": None,
        "seconds": 0.0,
    }  # fmt: skip


def nothing(case: Case, _context: RunContext, attempt: int) -> Row:
    """A case without a stack."""
    time.sleep(float(os.environ.get(SECONDS, "0")))
    return row_of(case.id) | {"attempts": attempt}


def cases_of(count: int) -> list[Case]:
    """Cases with a place in a recording each, as a plan of many drives has."""
    connections = [(4096 + 300 * number, 300) for number in range(20)]
    return [
        Case(
            f"drive-{n // 10_000:04d}-{n % 10_000:04d}", f"s3://fleet/{n // 1000}.bag", "1",
            Window(n, n, n + 1), connections, [(n << 20, 1 << 20)], 100,
        )
        for n in range(count)
    ]  # fmt: skip
