"""The site is built without a warning, whole, and opens without a network."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.unit.site.pages import DOCS, ROOT, Page, is_elsewhere, pages_of_docs

# Beside the pages themselves: the start page under its other name, and the search.
MORE = {"index.html", "search.html"}


def build(target: Path, root: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """As `make docs` does it."""
    command = [sys.executable, "-m", "docs.site.build", str(target)]
    return subprocess.run(
        command, cwd=root, capture_output=True, text=True, timeout=300, check=False
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("site") / "html"
    done = build(target)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    return target


@pytest.fixture(scope="module")
def pages(site: Path) -> list[Page]:
    return [Page(path.resolve()) for path in sorted(site.rglob("*.html"))]


def test_there_is_a_page_for_each_file(site: Path, pages: list[Page]) -> None:
    made = {str(page.path.relative_to(site.resolve())) for page in pages}
    files = {str(p.relative_to(DOCS).with_suffix(".html")) for p in pages_of_docs()}
    assert len(files) >= 85
    assert made == files | MORE
    assert (site / "index.html").read_bytes() == (site / "README.html").read_bytes()


def test_no_link_is_dead_and_no_anchor(pages: list[Page]) -> None:
    by_path = {page.path: page for page in pages}
    wrong, counted = [], 0
    for page in pages:
        for link in page.links:
            if is_elsewhere(link):
                continue
            counted += 1
            file, anchor = page.target(link)
            there = file.is_file()
            if not there or (anchor and file in by_path and anchor not in by_path[file].anchors):
                wrong.append((page.path.name, link))
    assert wrong == []
    assert counted > 9_000


def test_nothing_is_loaded_from_elsewhere(pages: list[Page]) -> None:
    assets = {asset for page in pages for asset in page.assets}
    assert [a for a in assets if is_elsewhere(a) and not a.startswith("data:")] == []
    lost = [(p.path.name, a) for p in pages for a in p.assets if not p.target(a)[0].is_file()]
    assert lost == []
    styles = {page.target(a)[0] for page in pages for a in page.assets if ".css" in a}
    assert styles
    assert [path.name for path in styles if "http" in _loaded(path.read_text())] == []


def _loaded(style: str) -> str:
    """What a style sheet loads; an image in it (data:) is not loaded from anywhere."""
    named = [p.partition(")")[0] for p in style.replace("@import", "url(").split("url(")[1:]]
    return " ".join(name for name in named if not name.strip("'\" ").startswith("data:"))


def test_the_start_page_leads_to_every_page(site: Path, pages: list[Page]) -> None:
    start = next(page for page in pages if page.path.name == "index.html")
    reached = {start.target(link)[0] for link in start.links if not is_elsewhere(link)}
    files = {page.path for page in pages} - {site.resolve() / name for name in MORE}
    assert files - reached - {site.resolve() / "README.html"} == set()


def test_an_example_s_manifest_is_on_its_page_and_to_be_had(site: Path) -> None:
    page = Page((site / "examples/robot-state-publisher/README.html").resolve())
    shown = (site / "examples/robot-state-publisher/README.html").read_text()
    assert "SimulationJob" in shown
    assert "robot_state_publisher" in shown
    assert "job-yaml" in page.anchors
    crd = Page((site / "reference/simulationjob.html").resolve())
    (link,) = [link for link in crd.links if link.endswith("simulationjobs.yaml")]
    assert crd.target(link)[0].read_text() == (ROOT / "crds/simulationjobs.yaml").read_text()


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What the build says of a small documentation with every fault that it must refuse."""
    root = tmp_path_factory.mktemp("faulty")
    shutil.copytree(DOCS / "site", root / "docs/site", ignore=shutil.ignore_patterns("__pyc*"))
    dead = "[a](none.md) [b](tasks/a.md#none) [c](tasks) [d](#t)"
    page = f"# T\n\n{dead}\n\n## Tasks\n\n[a](tasks/a.md)\n"
    files = {"README.md": page, "tasks/a.md": "# A\n", "tasks/b.md": "# B\n", "lost.md": "# L\n"}
    for name, text in files.items():
        (root / "docs" / name).parent.mkdir(exist_ok=True)
        (root / "docs" / name).write_text(text)
    done = build(root / "html", root)
    assert done.returncode == 1
    return done.stderr


@pytest.mark.parametrize("words", ["none.md", "'none'", "'tasks'", "lost.md"])
def test_the_build_refuses_dead_links_and_pages_outside_the_navigation(
    faulty: str, words: str
) -> None:
    assert words in faulty
    assert "tasks/b.md" not in faulty
