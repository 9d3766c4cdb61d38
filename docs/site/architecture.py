"""Writes docs/architecture.md: the folders, what each is for, and what it imports.

.venv/bin/python -m docs.site.architecture           write it
.venv/bin/python -m docs.site.architecture --check   say whether it is up to date

Read from the imports, so that it stays true.
"""

import ast
import re
import sys
import tomllib
from graphlib import TopologicalSorter
from pathlib import Path

import grimp

from docs.site.generated import keep
from docs.site.rust_modules import CRATES, ROOT, Graph, graph

PROJECT = Path(__file__).parents[2]
PAGE = PROJECT / "docs/architecture.md"
SOURCES = {"bagpipe": "images/spark/src", "bagpipe_operator": "operator/src"}
HEAD = """\
# The architecture, as a map

Every folder of the two packages and of the crates, what it is for, and which others it imports. A
folder stands above those that it imports. Written by `python -m docs.site.architecture` from the
imports themselves; `make docs` fails where it is not up to date. Why it is so: [design](design.md).
"""
PARTS = [
    ("bagpipe", "The data plane: `images/spark/src/bagpipe`"),
    ("bagpipe.engine", "Engines: `images/spark/src/bagpipe/engine`"),
    ("bagpipe.source", "Sources: `images/spark/src/bagpipe/source`"),
    ("bagpipe_operator", "The operator: `operator/src/bagpipe_operator`"),
    ("bagpipe_operator.jobs", "The operator's jobs: `operator/src/bagpipe_operator/jobs`"),
]


def main(words: list[str]) -> int:
    """0 where all is well."""
    return keep(PAGE, page(), "docs.site.architecture", words)


def page() -> str:
    """The whole page."""
    imports = grimp.build_graph(*SOURCES)
    parts = [HEAD.rstrip("\n")]
    for package, title in PARTS:
        rooms = sorted(imports.find_children(package))
        edges = {room: _imported(imports, room, rooms) for room in rooms}
        parts.append(section(title, edges, {room: purpose(room) for room in rooms}))
    crates = {path.parent.name: path for path in CRATES.glob("*/Cargo.toml")}
    used = {name: _crates(path) & crates.keys() for name, path in crates.items()}
    about = {name: _first_doc(path.parent / "src") for name, path in crates.items()}
    parts.append(section("The crates: `images/agent/crates`", used, about))
    agent = CRATES / "agent/src"
    rooms_of_agent = folders("agent")
    about = {room: _first_doc(agent, room) for room in rooms_of_agent}
    parts.append(section("The agent: `images/agent/crates/agent/src`", rooms_of_agent, about))
    return "\n\n".join(parts) + "\n"


def section(title: str, edges: Graph, about: dict[str, str]) -> str:
    """A table, those that nobody imports first."""
    used: Graph = {room: set() for room in edges}
    for room, others in edges.items():
        for other in others:
            used[other].add(room)
    order = _in_order(used)
    rows = [f"## {title}", "", "| | what it is for | imports |", "|---|---|---|"]
    short = {room: room.rpartition(".")[2] for room in edges}
    for room in order:
        imported = ", ".join(short[other] for other in order if other in edges[room])
        rows.append(f"| `{short[room]}` | {about[room]} | {imported} |")
    return "\n".join(rows)


def folders(crate: str) -> Graph:
    """The crate's modules by their first folder."""
    found: Graph = {}
    for name, others in graph(crate).items():
        if name == ROOT:
            continue
        mine = name.split("::")[0]
        found.setdefault(mine, set()).update({o.split("::")[0] for o in others} - {mine, ROOT})
    return found


def purpose(module: str) -> str:
    """The first sentence of a module's docstring."""
    place = PROJECT / SOURCES[module.partition(".")[0]] / module.replace(".", "/")
    file = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    return _sentence(ast.get_docstring(ast.parse(file.read_text())) or "")


def _imported(imports: grimp.ImportGraph, room: str, rooms: list[str]) -> set[str]:
    return {
        other
        for other in rooms
        if other != room
        and imports.direct_import_exists(importer=room, imported=other, as_packages=True)
    }


def _in_order(users: Graph) -> list[str]:
    sorter = TopologicalSorter({room: sorted(of) for room, of in sorted(users.items())})
    sorter.prepare()
    order: list[str] = []
    while sorter.is_active():
        ready = sorted(sorter.get_ready())
        order += ready
        sorter.done(*ready)
    return order


def _crates(manifest: Path) -> set[str]:
    asked = tomllib.loads(manifest.read_text()).get("dependencies", {})
    return {name.removeprefix("bagpipe-") for name in asked if name.startswith("bagpipe-")}


def _first_doc(source: Path, room: str = "") -> str:
    names = [f"{room}.rs", f"{room}/mod.rs"] if room else ["lib.rs", "main.rs"]
    file = next(source / name for name in names if (source / name).exists())
    text = "\n".join(re.findall(r"^//! ?(.*)$", file.read_text(), re.MULTILINE))
    return _sentence(text)


def _sentence(text: str) -> str:
    paragraph = " ".join(text.split("\n\n", maxsplit=1)[0].split())
    return re.split(r"(?<=\.)\s", paragraph)[0].replace("|", "\\|")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
