"""Every manifest in docs/examples is named on their page with the test that runs it."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "docs/examples"
ROW = re.compile(r"^\| ([\w-]+/[\w.-]+\.yaml) \| (.*) \|$", re.MULTILINE)
TEST = re.compile(r"`(tests/[\w/]+\.py)::(test_\w+)`")


def named() -> dict[str, list[tuple[str, str]]]:
    """Manifest -> the files and functions of its tests, as the page says."""
    rows = ROW.findall((EXAMPLES / "README.md").read_text())
    return {manifest: TEST.findall(tests) for manifest, tests in rows}


def sources(path: Path, seen: set[Path]) -> Iterator[str]:
    """The text of a test's file, of the conftest beside it, and of what they import from tests."""
    if path in seen or not path.is_file():
        return
    seen.add(path)
    text = path.read_text()
    yield text
    yield from sources(path.with_name("conftest.py"), seen)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tests."):
            module = ROOT / (node.module or "").replace(".", "/")
            yield from sources(module.with_suffix(".py"), seen)
            for name in node.names:
                yield from sources(module / f"{name.name}.py", seen)


def reads(text: str, manifest: str) -> bool:
    """Whether a test's sources name a manifest: its path, or its folder and its file."""
    folder, file = manifest.split("/")
    return manifest in text or (f'examples/{folder}"' in text and f'"{file}"' in text)


def faults(manifest: str, file: str, test: str) -> list[str]:
    """Why a test does not run a manifest: not there, not in `make test`, or of something else."""
    path = ROOT / file
    if not path.is_file():
        return [f"{file} is not there"]
    tree = ast.parse(path.read_text())
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    found = [n for n in tree.body if isinstance(n, kinds) and n.name == test]
    if not found:
        return [f"{file} has no {test}"]
    marks = [ast.unparse(mark) for mark in found[0].decorator_list]
    marks += [ast.unparse(n) for n in tree.body if ast.unparse(n).startswith("pytestmark")]
    found_faults = [f"{test} is not in make test" for mark in marks if "slow" in mark]
    if not reads("\n".join(sources(path, set())), manifest):
        found_faults.append(f"{file} does not read {manifest}")
    return found_faults


def test_every_manifest_has_a_test_and_no_other_is_named() -> None:
    there = {str(path.relative_to(EXAMPLES)) for path in EXAMPLES.rglob("*.yaml")}
    assert there == set(named())
    assert len(there) >= 10
    assert [manifest for manifest, tests in named().items() if not tests] == []


def test_the_named_tests_are_there_run_by_make_test_and_read_their_manifest() -> None:
    wrong = {
        manifest: found_faults
        for manifest, tests in named().items()
        for file, test in tests
        if (found_faults := faults(manifest, file, test))
    }
    assert wrong == {}


def test_a_test_that_does_not_run_a_manifest_is_found_out() -> None:
    main = ("tests/e2e/test_main_job.py", "test_the_examples_job_is_complete_and_lossless")
    assert faults("robot-state-publisher/job.yaml", *main) == []
    assert faults("barrier-car/job.yaml", *main) == [
        "tests/e2e/test_main_job.py does not read barrier-car/job.yaml"
    ]
    assert faults("x/job.yaml", "tests/none.py", "test_x") == ["tests/none.py is not there"]
    (lost,) = faults("robot-state-publisher/job.yaml", main[0], "test_nothing")
    assert lost == "tests/e2e/test_main_job.py has no test_nothing"
