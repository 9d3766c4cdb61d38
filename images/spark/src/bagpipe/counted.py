"""Numbers of things in sentences."""


def counted(count: int, noun: str) -> str:
    """`1 case`, `0 cases` or `2,000 cases`, of a noun whose plural ends with an s."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"
