"""The package is on no index: no page says to install it by its bare name."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[3]
PLACES = ("docs", "images/spark/src", "operator/src", "charts")
TEXTS = {".md", ".py", ".txt", ".yaml", ".sh"}
# Of a path of this checkout, or of a file in an image, a name follows a slash.
BARE = re.compile(r"pip3? install\b[^\n]*?(?<![\w/.-])bagpipe")


def test_no_page_and_no_sentence_installs_what_is_not_published() -> None:
    files = [path for place in PLACES for path in (ROOT / place).rglob("*")]
    files = [path for path in files if path.suffix in TEXTS and path.is_file()]
    files.append(ROOT / "README.md")
    assert ROOT / "docs/tasks/kubectl-plugin.md" in files
    found = [
        f"{path.relative_to(ROOT)}: {command.group()}"
        for path in files
        for command in BARE.finditer(path.read_text())
    ]
    assert found == []


def test_what_it_looks_for() -> None:
    assert BARE.search("pip install 'bagpipe[cli]'")
    assert BARE.search("pip install --quiet bagpipe")
    assert not BARE.search("bagpipe-cli/bin/pip install './images/spark[cli]'")
    assert not BARE.search("pip install --no-deps /tmp/packages/bagpipe")
