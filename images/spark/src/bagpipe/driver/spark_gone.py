"""That Spark is gone, which is no fault of the job."""


class SparkGoneError(Exception):
    """Spark's JVM has ended, or has stopped its work, while cases were to run."""

    def __init__(self) -> None:
        super().__init__(
            "Spark's Java process is gone or has stopped its work; what is done is in the journal"
        )
