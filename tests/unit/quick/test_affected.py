"""`make quick` runs the unit tests that a change can break, nearest first, and no others."""

import re
from pathlib import Path

import pytest

from tests.quick.affected import LOADED, Sources, affected, read

ROOT = Path(__file__).parents[3]
ENGINE = "images/spark/src/bagpipe/engine"
SOURCE = "images/spark/src/bagpipe/source"
FILES = {
    "images/spark/src/bagpipe/__init__.py": "",
    "images/spark/src/bagpipe/texts.py": "import re",
    "images/spark/src/bagpipe/spec.py": "from bagpipe.texts import each_once",
    "images/spark/src/bagpipe/plan/__init__.py": "",
    "images/spark/src/bagpipe/plan/cases.py": "def f():\n    import bagpipe.spec",
    "images/build/context.py": 'FOLDER = "images"',
    "crds/generate.py": 'FILE = "simulationjobs.yaml"',
    "tests/unit/conftest.py": "",
    "tests/unit/plan/builders.py": "from bagpipe.plan import cases",
    "tests/unit/plan/test_cases.py": "from tests.unit.plan import builders",
    "tests/unit/bagpipe/test_texts.py": "from bagpipe import texts",
    "tests/unit/crds/test_crd.py": "import crds.generate",
    "tests/cluster/test_images.py": "import context",
    "tests/e2e/test_main_job.py": "import bagpipe.texts",
}


@pytest.fixture
def sources(tmp_path: Path) -> Sources:
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return read(tmp_path)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ("images/spark/src/bagpipe/texts.py",
         {"tests/unit/bagpipe/test_texts.py": 1, "tests/unit/plan/test_cases.py": 4}),
        ("images/spark/src/bagpipe/plan/cases.py", {"tests/unit/plan/test_cases.py": 2}),
        ("tests/unit/plan/test_cases.py", {"tests/unit/plan/test_cases.py": 0}),
        ("images/build/context.py", {"tests/cluster/test_images.py": 1}),
        ("crds/simulationjobs.yaml", {"tests/unit/crds/test_crd.py": 2}),
        ("README.md", {}),
        ("tests/e2e/test_main_job.py", {}),
    ],
)  # fmt: skip
def test_what_a_change_can_break(sources: Sources, changed: str, expected: dict[str, int]) -> None:
    found = affected(sources, [Path(changed)])
    assert {str(path): distance for path, distance in found.items()} == expected


def test_a_configuration_is_that_of_all_below_it(sources: Sources) -> None:
    found = affected(sources, [Path("tests/unit/conftest.py")])
    assert sorted(path.name for path in found) == ["test_cases.py", "test_crd.py", "test_texts.py"]


def test_what_everything_is_installed_by_can_break_everything(sources: Sources) -> None:
    assert len(affected(sources, [Path("uv.lock")])) == 4


def test_the_nearest_of_two_changes_counts(sources: Sources) -> None:
    changed = [Path("images/spark/src/bagpipe/texts.py"), Path("tests/unit/plan/builders.py")]
    assert affected(sources, changed)[Path("tests/unit/plan/test_cases.py")] == 1


@pytest.fixture(scope="module")
def project() -> Sources:
    return read(ROOT)


def test_this_project_s_own_tests_are_found(project: Sources) -> None:
    found = affected(project, [Path("tests/quick/affected.py")])
    assert found[Path(__file__).relative_to(ROOT)] == 1


@pytest.mark.parametrize(
    ("changed", "test"),
    [
        (f"{ENGINE}/exec/engine.py", "bagpipe/test_exec_engine.py"),
        (f"{ENGINE}/ros1/engine.py", "bagpipe/test_case_run.py"),
        (f"{ENGINE}/exec/fields.py", "bagpipe/test_spec.py"),
        (f"{ENGINE}/exec/fields.py", "crds/test_crd.py"),
        (f"{ENGINE}/exec/__init__.py", "bagpipe/test_spec.py"),
        ("images/spark/src/bagpipe/engine_fields.py", "bagpipe/test_added_engine.py"),
        (f"{SOURCE}/sequence/source.py", "bagpipe/test_sequences.py"),
        (f"{SOURCE}/simulator/source.py", "simulator/test_job.py"),
        (f"{SOURCE}/files/fields.py", "bagpipe/test_spec.py"),
        (f"{SOURCE}/files/fields.py", "crds/test_crd.py"),
        (f"{SOURCE}/bags/__init__.py", "bagpipe/test_spec.py"),
        ("images/spark/src/bagpipe/installed.py", "bagpipe/test_spec.py"),
        ("images/spark/src/bagpipe/source_fields.py", "bagpipe/test_added_source.py"),
        ("tests/toy_source/bagpipe_sources/ticks/source.py", "bagpipe/test_added_source.py"),
        ("tests/toy_engine/bagpipe_engines/loopback/engine.py", "bagpipe/test_added_engine.py"),
        ("images/spark/src/bagpipe/cli/plan.py", "cli/test_plan.py"),
        ("crds/generate.py", "crds/test_crd.py"),
    ],
)
def test_what_is_loaded_by_its_name_is_followed_too(
    project: Sources, changed: str, test: str
) -> None:
    assert Path("tests/unit", test) in affected(project, [Path(changed)])


def test_whatever_loads_modules_by_their_names_says_which(project: Sources) -> None:
    product = [path for path in project.texts if path.parts[0] in {"images", "operator"}]
    loads = re.compile(r"\b(import_module|of_engine|of_source)\(")
    loaders = {str(path) for path in product if loads.search(project.texts[path])}
    assert loaders == {path for path in LOADED if Path(path) in product}


@pytest.mark.parametrize("pattern", sorted({each for few in LOADED.values() for each in few}))
def test_each_pattern_of_what_is_loaded_finds_a_file(project: Sources, pattern: str) -> None:
    assert any(path.match(pattern) for path in project.texts)
