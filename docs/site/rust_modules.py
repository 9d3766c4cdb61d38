"""Which module of a crate names which, read from the sources. Pure but for reading."""

import re
from collections.abc import Iterator
from pathlib import Path

CRATES = Path(__file__).parents[2] / "images/ros/crates"

Graph = dict[str, set[str]]


def modules(crate: str) -> dict[str, str]:
    """Each module's text by its path below `crate::`, without comments and tests."""
    found = {}
    for path in sorted((CRATES / crate / "src").rglob("*.rs")):
        name = "::".join(path.relative_to(CRATES / crate / "src").with_suffix("").parts)
        text = re.split(r"#\[cfg\(test\)\]\s*mod \w+ \{", path.read_text())[0]
        found[name.removesuffix("::mod")] = re.sub(r"//.*", "", text)
    return {name: text for name, text in found.items() if not name.startswith("rehearsal")}


def exported(root: str) -> dict[str, str]:
    """What the crate's root re-exports, with its module."""
    names: dict[str, str] = {}
    for module, group in re.findall(r"pub use (\w+)::\{?([^;]*?)\}?;", root):
        names |= dict.fromkeys(re.findall(r"\w+", group), module)
    return names


def paths(text: str) -> Iterator[str]:
    """What stands after `crate::`, groups taken apart."""
    for group in re.findall(r"crate::\{(.*?)\};", text, re.DOTALL):
        yield from (part.strip() for part in re.sub(r"::\{[^}]*\}", "", group).split(","))
    yield from re.findall(r"crate::(\w[\w:]*)", text)


def graph(crate: str) -> Graph:
    """Which module names which, by the longest path that is one."""
    known = modules(crate)
    roots = [known.pop(name) for name in ("lib", "main") if name in known]
    names = exported("".join(roots))
    edges: Graph = {name: set() for name in known}
    for name, text in known.items():
        for path in paths(text):
            words = path.split("::")
            prefixes = ["::".join(words[:end]) for end in range(len(words), 0, -1)]
            target = next((p for p in prefixes if p in known), names.get(words[0], ""))
            edges[name] |= {target} - {name, ""}
        # A module and its own file are one where the parent declares it.
        edges[name] -= {other for other in edges[name] if other.startswith(f"{name}::")}
    return edges
