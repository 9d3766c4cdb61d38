"""Every relative link and anchor of README.md and docs leads somewhere, on a forge too."""

import os
from collections import deque
from pathlib import Path

from tests.unit.site.pages import DOCS, ROOT, anchors, is_elsewhere, links, pages_of_docs, slug


def named(file: Path, path: Path, text: str) -> set[str]:
    """The anchors of a file that the file `path` with this text links to."""
    return anchors(text if file == path else file.read_text())


def dead(path: Path, text: str) -> list[str]:
    """The links of a Markdown file that lead nowhere."""
    found = []
    for link in links(text):
        if is_elsewhere(link):
            continue
        target, _, anchor = link.partition("#")
        file = (path.parent / target).resolve() if target else path
        if not file.exists() or (anchor and anchor not in named(file, path, text)):
            found.append(link)
    return found


def test_no_link_is_dead() -> None:
    files = [ROOT / "README.md", *pages_of_docs()]
    assert len(files) >= 86
    counted = sum(len(links(path.read_text())) for path in files)
    assert counted >= 280
    wrong = {str(path.relative_to(ROOT)): dead(path, path.read_text()) for path in files}
    assert {path: found for path, found in wrong.items() if found} == {}


def test_dead_links_and_anchors_are_found() -> None:
    text = "# A `b.c`\n\n[x](#a-bc) [y](#a-b) [z](limits.md) [u](none.md) [v](limits.md#nothing)\n"
    assert dead(DOCS / "README.md", text) == ["#a-b", "none.md", "limits.md#nothing"]


def test_anchors_are_those_of_a_forge() -> None:
    assert slug("What the stack used") == "what-the-stack-used"
    assert slug("`fifo=`: a program that runs already") == "fifo-a-program-that-runs-already"
    assert slug("spec.spark.executor.pod") == "specsparkexecutorpod"
    assert anchors("# Twice\n\n## Twice\n") == {"twice", "twice-1"}


def test_every_page_is_reached_from_the_first_one() -> None:
    """By links alone, as on a forge, where there is no navigation."""
    waiting, reached = deque([DOCS / "README.md"]), {DOCS / "README.md"}
    while waiting:
        path = waiting.popleft()
        for link in links(path.read_text()):
            file = Path(os.path.normpath(path.parent / link.partition("#")[0]))
            file = file / "README.md" if file.is_dir() else file
            if is_elsewhere(link) or link.startswith("#"):
                continue
            if file.suffix == ".md" and file not in reached:
                reached.add(file)
                waiting.append(file)
    lost = sorted(str(p.relative_to(DOCS)) for p in set(pages_of_docs()) - reached)
    assert lost == [], "link it, for example from docs/README.md"
