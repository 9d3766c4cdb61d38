"""What can go wrong between a partition's records and their results, as sentences."""

from collections.abc import Sequence


class BinPipedError(Exception):
    """User logic that failed; `reason` is CamelCase, `stderr` the program's last lines.

    The text holds everything, because the text is what Spark carries to the driver.
    """

    def __init__(
        self,
        reason: str,
        message: str,
        *,
        exit_status: int | None = None,
        signal: int | None = None,
        stderr: Sequence[str] = (),
    ) -> None:
        lines = "".join(f"\n    {line}" for line in stderr)
        words = f"; its last lines on stderr:{lines}" if stderr else ""
        super().__init__(f"{reason}: {message}{words}")
        self.reason = reason
        self.exit_status = exit_status
        self.signal = signal
        self.stderr = list(stderr)


class CollectTooLargeError(Exception):
    """Results that the driver was asked to hold and that are above what it may hold, in bytes."""

    def __init__(self, message: str, actual: int, limit: int) -> None:
        super().__init__(message)
        self.actual = actual
        self.limit = limit
