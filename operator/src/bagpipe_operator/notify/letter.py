"""What is sent: one event for one receiver, and what became of it. Pure."""

from dataclasses import dataclass
from typing import Literal

State = Literal["Delivered", "Failed", "Dropped"]


@dataclass(frozen=True)
class Letter:
    """One event for one receiver; `identity` is the same each time that it is sent."""

    uid: str  # of the job that it is about
    about: str  # its namespace and name, for the log
    receiver: str
    identity: str
    body: bytes

    @property
    def namespace(self) -> str:
        """Of the job that it is about."""
        return self.about.partition("/")[0]


@dataclass(frozen=True)
class Outcome:
    """What became of a letter, with a sentence where it did not arrive."""

    state: State
    message: str = ""


@dataclass(frozen=True)
class Answer:
    """What one try came to; `words` says what went wrong, without an address or a body."""

    accepted: bool
    words: str = ""
    final: bool = False  # another try would be in vain
    wait_seconds: float = 0.0  # what the receiver asks for before the next one
