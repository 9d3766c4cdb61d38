"""Which module of a crate names which, read from the sources. Pure but for reading."""

import re
from collections.abc import Iterator
from pathlib import Path

CRATES = Path(__file__).parents[2] / "images/agent/crates"

Graph = dict[str, set[str]]
# The crate's own file, as a node.
ROOT = "crate"
# Modules of tests alone.
_TESTS = re.compile(
    r"#\[cfg\(test\)\]\s*(?:#\[[^\]]*\]\s*)*(?:pub(?:\([^)]*\))? )?mod (\w+)\s*[;{]"
)
# Letters first, of which one may be a quote.
_NO_CODE = re.compile(
    r"""'(?:\\.|[^'\\])'|\br(#*)".*?"\1|"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/""", re.DOTALL
)
_PATH = re.compile(r"(?<![\w:])(crate|self|super)((?:::\w+)+)")
_USE = re.compile(r"\b(pub(?:\([^)]*\))? )?use ([^;]+);")


def crates() -> list[str]:
    """All crates of the workspace."""
    return sorted(path.parent.name for path in CRATES.glob("*/Cargo.toml"))


def modules(crate: str) -> dict[str, str]:
    """Each module's text by its path, without comments, strings and tests."""
    source = CRATES / crate / "src"
    found, of_tests = {}, set()
    for path in sorted(source.rglob("*.rs")):
        parts = path.relative_to(source).with_suffix("").parts
        name = "::".join(parts).removesuffix("::mod")
        name = ROOT if name in {"lib", "main"} else name
        text, tests = without_tests(_NO_CODE.sub("", path.read_text()))
        found[name] = text
        prefix = "" if name == ROOT else f"{name}::"
        of_tests |= {prefix + test for test in tests}
    return {
        name: text
        for name, text in found.items()
        if not any(name == test or name.startswith(f"{test}::") for test in of_tests)
    }


def without_tests(text: str) -> tuple[str, set[str]]:
    """The text without its blocks of tests, and the names of modules that are for tests."""
    names = set()
    while match := _TESTS.search(text):
        names.add(match[1])
        end = match.end()
        depth = 1 if match[0].endswith("{") else 0
        while depth and end < len(text):
            depth += {"{": 1, "}": -1}.get(text[end], 0)
            end += 1
        text = text[: match.start()] + text[end:]
    return text, names


def trees(tree: str) -> Iterator[list[str]]:
    """The paths of a `use`, groups taken apart and other names left out."""
    tree = tree.strip()
    head, brace, rest = tree.partition("{")
    if not brace:
        yield [part.strip() for part in re.sub(r"\s+as\s+\w+", "", tree).split("::")]
        return
    before = [part.strip() for part in head.split("::") if part.strip()]
    for part in _parts(rest[: rest.rindex("}")]):
        for path in trees(part):
            yield before + path


def _parts(group: str) -> Iterator[str]:
    depth, begin = 0, 0
    for at, letter in enumerate(group + ","):
        depth += {"{": 1, "}": -1}.get(letter, 0)
        if letter == "," and not depth:
            if part := group[begin:at].strip():
                yield part
            begin = at + 1


def paths(text: str) -> Iterator[list[str]]:
    """Every path that a module names, also those outside of `use`."""
    for _, tree in _USE.findall(text):
        yield from trees(tree)
    for root, rest in _PATH.findall(_USE.sub("", text)):
        yield [root, *rest.removeprefix("::").split("::")]


def absolute(path: list[str], module: str, known: dict[str, str]) -> list[str] | None:
    """The path from the crate's root; None of another crate's."""
    at = [] if module == ROOT else module.split("::")
    match path[0]:
        case "crate":
            return path[1:]
        case "self":
            return at + path[1:]
        case "super":
            ups = next((n for n, part in enumerate(path) if part != "super"), len(path))
            return at[: len(at) - ups] + path[ups:]
        case child:
            return at + path if "::".join([*at, child]) in known else None


def exported(known: dict[str, str]) -> dict[str, str]:
    """What the root re-exports, with where it comes from."""
    names = {}
    for public, tree in _USE.findall(known[ROOT]):
        for path in trees(tree) if public else ():
            target = absolute(path, ROOT, known)
            if target:
                names[target[-1]] = _longest(target, known)
    return names


def _longest(path: list[str], known: dict[str, str]) -> str:
    for end in range(len(path), 0, -1):
        if (name := "::".join(path[:end])) in known:
            return name
    return ROOT


def graph(crate: str) -> Graph:
    """Which module names which. What the root re-exports counts for where it comes from."""
    known = modules(crate)
    again = exported(known)
    edges: Graph = {name: set() for name in known}
    for name, text in known.items():
        for path in paths(text):
            target = absolute(path, name, known)
            if target:
                found = _longest(target, known)
                found = again.get(target[0], ROOT) if found == ROOT else found
                edges[name] |= {found} - {name}
    # The root declares all modules and re-exports from them.
    edges[ROOT] = set()
    return edges


def unreachable(source: Path) -> list[str]:
    """Files below a folder of sources that no module declares, so that nobody compiles them."""
    found = []
    for path in sorted(source.rglob("*.rs")):
        parts = path.relative_to(source).with_suffix("").parts
        if parts in {("lib",), ("main",)}:
            continue
        *above, name = parts[:-1] if parts[-1] == "mod" else parts
        parents = [source.joinpath(*above, "mod.rs"), source.joinpath(*above).with_suffix(".rs")]
        parents += [source / "lib.rs", source / "main.rs"] if not above else []
        declared = re.compile(rf"\bmod {name};")
        if not any(declared.search(_text(parent)) for parent in parents):
            found.append(str(path.relative_to(source)))
    return found


def undeclared_of_tests(crate: str) -> list[str]:
    """Files below a folder of a crate's tests that no test of any crate declares."""
    tests = CRATES / crate / "tests"
    declared = set()
    for path in CRATES.glob("*/tests/**/*.rs"):
        declared |= set(re.findall(r"\bmod (\w+);", _text(path)))
    below = [path for path in sorted(tests.rglob("*.rs")) if path.parent != tests]
    named = [(path, path.parent.name if path.stem == "mod" else path.stem) for path in below]
    return [str(path) for path, name in named if name not in declared | {"main"}]


def _text(path: Path) -> str:
    return _NO_CODE.sub("", path.read_text()) if path.is_file() else ""
