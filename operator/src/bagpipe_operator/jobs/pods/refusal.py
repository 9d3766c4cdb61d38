"""What the API server says when it does not let a child of a job be created."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Refusal:
    """The API server does not let a child be created."""

    reason: str
    message: str
    lasting: bool = True  # only a person can mend it

    @property
    def key(self) -> tuple[str, str, bool]:
        """Another one is another thing to wait for: its own patience begins with it."""
        return ("refused", self.reason, self.lasting)
