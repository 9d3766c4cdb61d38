"""Where each page stands in the site's navigation: as the READMEs name it, then by its folder.

Nobody keeps a list for the site. docs/README.md is the table of contents that people read on a
forge; its headings and the order of its links are the site's. A page that it does not name yet
stands at the end of the section that is called as its folder. The README.md of any other folder
is the parent of all pages below it. A page is its path below docs/ without `.md`.
"""

import posixpath
import re
from collections.abc import Collection
from dataclasses import dataclass

ROOT = "README"
_HEADING = re.compile(r"^## +(.+?) *$", re.MULTILINE)
_LINK = re.compile(r"\]\(([^)#\s]+)")


@dataclass(frozen=True)
class Section:
    """A part of the navigation: its caption, and its pages in order."""

    caption: str
    pages: list[str]


def is_index(page: str) -> bool:
    """Whether a page is the README.md of its folder."""
    return posixpath.basename(page) == ROOT


def parent(page: str, pages: Collection[str]) -> str:
    """The README below which a page stands: the nearest one above it that exists."""
    folder = posixpath.dirname(page)
    if is_index(page):
        folder = posixpath.dirname(folder)
    while folder and f"{folder}/{ROOT}" not in pages:
        folder = posixpath.dirname(folder)
    return f"{folder}/{ROOT}" if folder else ROOT


def children(index: str, text: str, pages: Collection[str]) -> list[str]:
    """The pages below a README: those that its text names, in its order, then all others."""
    own = {page for page in pages if page != ROOT and parent(page, pages) == index}
    named = [page for page in _named(text, posixpath.dirname(index), pages) if page in own]
    return [*named, *sorted(own - set(named))]


def sections(text: str, pages: Collection[str]) -> list[Section]:
    """The site's navigation, from the text of docs/README.md.

    A page that is in none of them is left out, and the strict build names it.
    """
    heads = list(_HEADING.finditer(text))
    ends = [head.start() for head in heads[1:]] + [len(text)]
    parts = {head[1]: text[head.end() : end] for head, end in zip(heads, ends, strict=True)}
    free = children(ROOT, text, pages)
    found = []
    for caption, part in parts.items():
        named = [page for page in _named(part, "", pages) if page in free]
        free = [page for page in free if page not in named]
        found.append(Section(caption, named))
    for section in found:
        section.pages.extend(p for p in free if p.startswith(f"{section.caption.lower()}/"))
    return [section for section in found if section.pages]


def _named(text: str, folder: str, pages: Collection[str]) -> list[str]:
    """The pages that a text in a folder links to, each once; a folder stands for its README."""
    found = []
    for target in _LINK.findall(text):
        path = posixpath.normpath(posixpath.join(folder, target))
        for page in (path.removesuffix(".md"), f"{path}/{ROOT}"):
            if page in pages and page not in found:
                found.append(page)
    return found
