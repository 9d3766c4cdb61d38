"""A release's notes: its section of CHANGELOG.md."""

from __future__ import annotations

import re

from release import ReleaseError
from release.version import ROOT

# The links of CHANGELOG.md go to files of the checkout, which readers of a release do not have.
_LINK = re.compile(r"\[([^\]]+)\]\((?!https?://)[^)]+\)")
_ITEM = re.compile(r"^- (.*?)(?=^- |^#|\Z)", re.MULTILINE | re.DOTALL)


def notes(version: str) -> str:
    """The text below a version's heading, `## 0.2.0`, without links into the checkout.

    Raises ReleaseError where CHANGELOG.md has no such heading, or nothing below it.
    """
    text = (ROOT / "CHANGELOG.md").read_text()
    found = re.search(
        rf"^## {re.escape(version)}(?: [^\n]*)?$(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL
    )
    body = _LINK.sub(r"\1", found[1]).strip() if found else ""
    if not body:
        raise ReleaseError(
            f"CHANGELOG.md says nothing of {version}: write what users notice below a heading"
            f" `## {version}`."
        )
    return f"# Bagpipe {version}\n\n{body}\n"


def changes(version: str) -> list[str]:
    """The items of a release's notes, each in one line."""
    return [" ".join(item.split()) for item in _ITEM.findall(notes(version))]
