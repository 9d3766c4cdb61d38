"""Markdown files as a forge shows them, and pages of the built site as a browser reads them."""

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

from markdown_it import MarkdownIt
from markdown_it.token import Token

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs"
_PARSER = MarkdownIt("commonmark").enable("table")
# What makes a browser ask for something, by element.
_ASSETS = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href"}
# Links of the head that are only named and not loaded.
_NAMED = {"canonical", "next", "prev", "index", "search"}


def pages_of_docs() -> list[Path]:
    """The Markdown files of the documentation."""
    return sorted(DOCS.rglob("*.md"))


def _tokens(text: str) -> Iterator[Token]:
    for token in _PARSER.parse(text):
        yield token
        yield from token.children or []


def links(text: str) -> list[str]:
    """The targets of all links and images of a Markdown text, in order."""
    found = [token.attrGet("href") or token.attrGet("src") for token in _tokens(text)]
    return [unquote(str(target)) for target in found if target]


def slug(heading: str) -> str:
    """The anchor of a heading, as GitHub and GitLab make it."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def anchors(text: str) -> set[str]:
    """The anchors of all headings of a Markdown text; one that comes again gets a number."""
    found: dict[str, int] = {}
    names = set()
    tokens = _PARSER.parse(text)
    for opened, inline in itertools.pairwise(tokens):
        if opened.type != "heading_open":
            continue
        words = [child.content for child in inline.children or []]
        name = slug("".join(words))
        names.add(f"{name}-{found[name]}" if name in found else name)
        found[name] = found.get(name, 0) + 1
    return names


@dataclass
class Page(HTMLParser):
    """One page of the site: its links, its anchors, and what it loads."""

    path: Path
    links: list[str] = field(default_factory=list)
    anchors: set[str] = field(default_factory=set)
    assets: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self.feed(self.path.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = {name: value or "" for name, value in attrs}
        self.anchors |= {named[name] for name in ("id", "name") if name in named}
        if tag == "a" and "href" in named:
            self.links.append(unquote(named["href"]))
        elif tag in _ASSETS and _ASSETS[tag] in named and named.get("rel") not in _NAMED:
            self.assets.append(named[_ASSETS[tag]])

    def target(self, link: str) -> tuple[Path, str]:
        """The file and the anchor that a relative link leads to."""
        path, _, anchor = link.partition("#")
        file = (self.path.parent / path.partition("?")[0]).resolve() if path else self.path
        return file, anchor


def is_elsewhere(link: str) -> bool:
    """Whether a link leaves the checkout or the site."""
    return re.match(r"[a-z][a-z0-9+.-]*:|//", link) is not None
