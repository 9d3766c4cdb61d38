"""Which unit tests a change can break, by what they import, nearest first. Pure but for reading.

A Python file is near to what it imports or loads itself, and farther from what that
imports. Any other file is near to the sources that name it.
"""

import ast
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

# Where modules are found, as the tests find them.
ROOTS = ("images/spark/src", "operator/src", "images/build", "tests/cluster", ".")
SOURCES = ("images/build", "images/spark/src", "operator/src", "tests", "crds", "charts", "docs")
UNIT_TESTS = ("tests/unit", "tests/cluster")
_SPARK = "images/spark/src/bagpipe"
# What a file loads by name while it runs, without an import statement.
LOADED: Mapping[str, tuple[str, ...]] = {
    # What only Spark programs ask for: as imports these would have a change of one module of
    # binpiped run 113 files of tests, where 3 use it.
    f"{_SPARK}/__init__.py": (),
    f"{_SPARK}/cli/verb.py": (f"{_SPARK}/cli/*.py",),
    f"{_SPARK}/engine/chosen.py": (
        f"{_SPARK}/engine/*/__init__.py", f"{_SPARK}/engine/*/engine.py",
    ),
    f"{_SPARK}/engine_fields.py": (
        f"{_SPARK}/engine/*/__init__.py", f"{_SPARK}/engine/*/fields.py",
    ),
    f"{_SPARK}/source/chosen.py": (
        f"{_SPARK}/source/*/__init__.py", f"{_SPARK}/source/*/source.py",
    ),
    f"{_SPARK}/source_fields.py": (
        f"{_SPARK}/source/*/__init__.py", f"{_SPARK}/source/*/fields.py",
    ),
    # What it loads stands at those who ask it.
    f"{_SPARK}/installed.py": (),
    # Of another language.
    f"{_SPARK}/native.py": (),
    "tests/unit/bagpipe/test_added_engine.py": (
        "tests/toy_engine/bagpipe_engines/*/*.py", f"{_SPARK}/engine_fields.py",
    ),
    "tests/unit/bagpipe/test_added_source.py": (
        "tests/toy_source/bagpipe_sources/*/*.py", f"{_SPARK}/source_fields.py",
    ),
    "tests/unit/crds/test_crd.py": ("crds/generate.py",),
}  # fmt: skip
# A change of these can break anything.
OF_ALL = frozenset({"pyproject.toml", "uv.lock"})


@dataclass(frozen=True)
class Sources:
    """The Python files below a folder: what each imports, and its text."""

    imports: Mapping[Path, frozenset[Path]]
    texts: Mapping[Path, str]


def read(root: Path) -> Sources:
    """All sources below the project's folder; paths are relative to it."""
    files = [
        path.relative_to(root)
        for folder in SOURCES
        for path in sorted(root.glob(f"{folder}/**/*.py"))
    ]
    texts = {path: (root / path).read_text() for path in files}
    by_module = _by_module(files)
    imports = {
        path: frozenset(by_module[name] for name in _imported(path, text) if name in by_module)
        | _loaded(path, files)
        for path, text in texts.items()
    }
    return Sources(imports, texts)


def _by_module(files: Iterable[Path]) -> dict[str, Path]:
    found: dict[str, Path] = {}
    for path in files:
        for root in ROOTS:
            if root == "." or path.is_relative_to(root):
                inside = path if root == "." else path.relative_to(root)
                name = ".".join(inside.with_suffix("").parts).removesuffix(".__init__")
                found.setdefault(name, path)
    return found


def _imported(path: Path, text: str) -> set[str]:
    """All modules that a file may import, those within functions too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(text, str(path))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def _loaded(path: Path, files: Iterable[Path]) -> frozenset[Path]:
    """Those of the files that another loads without importing them."""
    patterns = LOADED.get(str(path), ())
    return frozenset(each for each in files if any(each.match(pattern) for pattern in patterns))


def affected(sources: Sources, changed: Iterable[Path]) -> dict[Path, int]:
    """The unit tests that the changed files can break, with how far each is from the change."""
    changed = set(changed)
    everywhere = any(str(path) in OF_ALL for path in changed)
    distances = _distances(sources, changed)
    return {
        test: distances.get(test, 9)
        for test in sources.texts
        if _is_unit_test(test) and (test in distances or everywhere)
    }


def _is_unit_test(path: Path) -> bool:
    return path.name.startswith("test_") and any(path.is_relative_to(each) for each in UNIT_TESTS)


def _distances(sources: Sources, changed: set[Path]) -> dict[Path, int]:
    """How many imports lie between each file and the nearest changed one."""
    importers: dict[Path, set[Path]] = defaultdict(set)
    for path, imported in sources.imports.items():
        for each in imported | _configurations(sources, path):
            importers[each].add(path)
    named = {
        path
        for path, text in sources.texts.items()
        for each in changed - set(sources.texts)
        if each.name in text or f'"{each.parts[0]}"' in text
    }
    distances = dict.fromkeys(changed & set(sources.texts), 0) | dict.fromkeys(named, 1)
    nearest = sorted(distances, key=lambda path: distances[path])
    for path in nearest:  # grows while it is walked: breadth first
        for importer in sorted(importers[path]):
            if importer not in distances:
                distances[importer] = distances[path] + 1
                nearest.append(importer)
    return distances


def _configurations(sources: Sources, path: Path) -> set[Path]:
    """The conftest.py of a test's folders, which nobody imports."""
    return {
        folder / "conftest.py"
        for folder in path.parents
        if path.parts[0] == "tests" and folder / "conftest.py" in sources.texts
    } - {path}
