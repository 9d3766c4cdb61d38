"""The site's order: as the READMEs have it, new pages at the end of their section."""

import re

from docs.site.navigation import Section, children, parent, sections
from tests.unit.site.pages import DOCS, pages_of_docs

TEXT = """# Title

## Start

- [Five](start.md)

## Tasks

- [B](tasks/b.md), [A](tasks/a.md#part), [B again](tasks/b.md), [elsewhere](https://example.org)

## Examples

- [All](examples), [one of them](examples/one/README.md)
"""
PAGES = [
    "README", "start", "tasks/a", "tasks/b", "tasks/new", "examples/README", "examples/other",
    "examples/one/README", "examples/one/more", "examples/two/deep/page",
]  # fmt: skip


def test_sections_have_the_order_of_the_text_and_then_what_is_new() -> None:
    assert sections(TEXT, PAGES) == [
        Section("Start", ["start"]),
        Section("Tasks", ["tasks/b", "tasks/a", "tasks/new"]),
        Section("Examples", ["examples/README"]),
    ]


def test_a_folder_s_readme_is_the_parent_of_what_lies_below() -> None:
    assert parent("examples/one/README", PAGES) == "examples/README"
    assert parent("examples/one/more", PAGES) == "examples/one/README"
    assert parent("examples/two/deep/page", PAGES) == "examples/README"
    assert parent("tasks/a", PAGES) == "README"
    assert parent("examples/README", PAGES) == "README"
    own = children("examples/README", "[one](one) [other](other.md)", PAGES)
    assert own == ["examples/one/README", "examples/other", "examples/two/deep/page"]


def test_every_page_of_the_documentation_stands_in_it_once() -> None:
    pages = [str(p.relative_to(DOCS))[: -len(".md")] for p in pages_of_docs()]
    text = (DOCS / "README.md").read_text()
    top = sections(text, pages)
    captions = re.findall(r"^## (.*)", text, re.MULTILINE)
    assert [section.caption for section in top] == captions
    assert captions == ["Start", "Tasks", "Concepts", "Operations", "Reference", "Examples"]
    placed = ["README", *(page for section in top for page in section.pages)]
    for index in [page for page in pages if page.endswith("/README")]:
        placed += children(index, (DOCS / f"{index}.md").read_text(), pages)
    assert sorted(placed) == sorted(pages)
