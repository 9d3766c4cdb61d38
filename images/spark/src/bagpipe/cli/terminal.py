"""What others wrote, on a terminal."""


def plain(text: str) -> str:
    """The text without what a terminal would obey."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def unstyled(text: str) -> str:
    """The same for rich, which would obey [red] as well."""
    # Verbs that draw nothing must not wait for it.
    from rich.markup import escape  # noqa: PLC0415

    return escape(plain(text))
