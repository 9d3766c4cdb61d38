"""Who stops reading the progress of a run ends it not, and gives no verdict."""

import io
from typing import Any

from bagpipe.cli.showing import QuietConsole, Showing


class Gone(io.StringIO):
    """stderr of a `tee` or a terminal that is gone."""

    writes = 0

    def write(self, text: str) -> int:  # noqa: ARG002  as that of any file
        self.writes += 1
        raise BrokenPipeError(32, "Broken pipe")


ACCOUNT: dict[str, Any] = {
    "phase": "Running", "warning": "",
    "cases": {"planned": 9, "running": 1, "passed": 1, "failed": 0, "invalid": 0, "errored": 0},
}  # fmt: skip


def test_nobody_who_reads_the_progress_is_no_verdict() -> None:
    gone = Gone()
    showing = Showing(QuietConsole(file=gone), 1, clock=iter(range(10, 1000, 10)).__next__)
    with showing:
        showing.show(ACCOUNT)
        showing.show(ACCOUNT | {"phase": "Complete"})
    assert gone.writes == 1
