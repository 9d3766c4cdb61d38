"""What keeps a job from its work, as the deciders hand it on."""

from dataclasses import dataclass, replace

from bagpipe.one_line import CUT, one_line

_LONGEST = 500


@dataclass(frozen=True)
class Trouble:
    """Something that keeps a pod from its work."""

    reason: str
    pod: str
    message: str
    container: str = ""
    lasting: bool = True  # only a person can mend it

    @property
    def key(self) -> tuple[str, str, str]:
        """What stays the same while the kubelet's wording changes."""
        return (self.reason, self.pod, self.container)

    def passing(self) -> "Trouble":
        """The same, where it may mend itself."""
        return replace(self, lasting=False)


def sentence(text: str) -> str:
    """Somebody else's words as one line of up to 500 characters that ends as a sentence."""
    line = one_line(text, _LONGEST)
    return line if not line or line.endswith((".", "!", "?", CUT)) else line + "."
