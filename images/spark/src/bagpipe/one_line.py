"""Somebody else's words, as they stand in messages: a library's, a manifest's, a kubelet's."""

CUT = "…"


def one_line(text: str, longest: int) -> str:
    """The words in one line of at most so many characters, which shows where it was cut."""
    line = " ".join(text.split())
    return line if len(line) <= longest else f"{line[: longest - 2].rstrip()} {CUT}"
