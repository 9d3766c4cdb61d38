"""What a stack has done so far, for the test and for its own other processes."""

import os
import pathlib


def mark(word="ran"):
    """Says for the test that this much has happened; every run adds a line."""
    with _path(word).open("a") as file:
        file.write(f"{os.getpid()}\n")


def runs_before(word="ran"):
    """How many runs of this stack have left their mark."""
    path = _path(word)
    return len(path.read_text().splitlines()) if path.exists() else 0


def _path(word):
    return pathlib.Path(os.environ["LIAR_MARKS"], os.environ["LIAR_NAME"] + "." + word)
