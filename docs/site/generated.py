"""Pages that are written by a program: kept, or compared with what it would write."""

import sys
from pathlib import Path


def keep(page: Path, text: str, module: str, words: list[str]) -> int:
    """Writes the page; with the word --check it only compares. 0 where all is well.

    `module` is what writes it, as `python -m` takes it.
    """
    if words != ["--check"]:
        page.write_text(text)
        return 0
    current = page.exists() and page.read_text() == text
    if not current:
        print(f"{page} is not up to date: python -m {module}", file=sys.stderr)
    return int(not current)
