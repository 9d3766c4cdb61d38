"""What Sphinx needs beyond MyST, so that plain Markdown with plain links is the whole source."""

import posixpath
import shutil
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx

from docs.site.navigation import ROOT, children, is_index, sections

_EXAMPLES = "examples/"


def setup(app: Sphinx) -> dict[str, Any]:
    """Sphinx calls this when it loads the extension."""
    app.connect("source-read", add_navigation)
    app.connect("doctree-read", lead_to_readmes)
    app.connect("build-finished", add_start_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def add_navigation(app: Sphinx, page: str, source: list[str]) -> None:
    """Append to a README what stands below it, and to an example's the manifests beside it."""
    if not is_index(page):
        return
    text, pages = source[0], app.env.found_docs
    if page == ROOT:
        trees = [_tree(part.pages, part.caption) for part in sections(text, pages)]
    else:
        trees = [_tree(children(page, text, pages))]
    source[0] = "\n".join([text, *_manifests(Path(app.srcdir), page), *trees])


def lead_to_readmes(app: Sphinx, page: nodes.document) -> None:
    """A link to a folder is one to its README, as on a forge; without one it stays a dead link."""
    for link in page.findall(pending_xref):
        if link.get("reftype") != "myst" or link.get("refdomain"):
            continue
        folder = posixpath.join(posixpath.dirname(link["refdoc"]), link["reftarget"])
        readme = posixpath.join(posixpath.normpath(folder), ROOT)
        if readme in app.env.found_docs:
            # As MyST itself marks a link to a file of the documentation.
            link.attributes |= {"refdomain": "doc", "reftarget": readme, "reftargetid": None}


def add_start_page(app: Sphinx, failure: Exception | None) -> None:
    """The start page under the name that servers and people look for."""
    if failure is None:
        shutil.copyfile(Path(app.outdir) / f"{ROOT}.html", Path(app.outdir) / "index.html")


def _tree(pages: list[str], caption: str = "") -> str:
    options = [":hidden:", *([f":caption: {caption}"] if caption else [])]
    return "\n".join(["", "```{toctree}", *options, "", *(f"/{page}" for page in pages), "```"])


def _manifests(docs: Path, page: str) -> list[str]:
    """A section with each manifest of an example's folder, as it is."""
    if not page.startswith(_EXAMPLES):
        return []
    files = sorted((docs / page).parent.glob("*.yaml"))
    shown = [
        f"\n### {file.name}\n\n```{{literalinclude}} {file.name}\n:language: yaml\n```"
        for file in files
    ]
    return ["\n## Manifests", *shown] if shown else []
