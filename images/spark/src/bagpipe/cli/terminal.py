"""What others wrote, on a terminal."""

from rich.markup import escape


def plain(text: str) -> str:
    """The text without what a terminal would obey."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def unstyled(text: str) -> str:
    """The same for rich, which would obey [red] as well."""
    return escape(plain(text))
