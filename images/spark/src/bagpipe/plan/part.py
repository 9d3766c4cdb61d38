"""A part of a recording: which bytes of which file, shifted to which time."""

from dataclasses import dataclass

from bagpipe.plan.fragments import Window


@dataclass(frozen=True)
class Part:
    """A window of one bag, in the bag's own times, in ns; `at` is its start in the case's time.

    `version` is the file's mark when it was planned; `topics` are those to be played (none: all);
    `connections` and `ranges` are (offset, length) in bytes, and `stated` is what the index states
    of their times, as a case has them.
    """

    bag: str
    version: str
    topics: list[str]
    window: Window
    at: int
    connections: list[tuple[int, int]]
    ranges: list[tuple[int, int]]
    messages: int
    stated: str = ""

    @property
    def shift(self) -> int:
        """What is added to a recorded time, in ns."""
        return self.at - self.window.start

    @property
    def end(self) -> int:
        """Where the next part begins, in the case's time."""
        return self.at + self.window.end - self.window.start

    @property
    def bytes(self) -> int:
        """Bytes that are read from storage."""
        return sum(length for _, length in self.connections + self.ranges)

    def as_row(self) -> dict[str, object]:
        """The part as a line of results has it."""
        window = [self.window.start, self.window.end]
        return {"bag": self.bag, "version": self.version, "window": window, "at": self.at}
