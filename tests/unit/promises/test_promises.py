"""Every promise of the documentation has a test, and every test's promise is one that is made."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.promises.page import Promise, faults, marks, promises

ROOT = Path(__file__).parents[3]
NEVER = Promise("never-drops", "playback.md", "The player never drops.")


def test_the_page_is_up_to_date() -> None:
    command = [sys.executable, "-m", "tests.promises.page", "--check"]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr


def test_a_mark_belongs_to_the_test_that_follows() -> None:
    # Not written out: this file is looked through for marks, too.
    mark = "Promise:"
    source = f"""
# {mark} never-drops, says-so
@pytest.mark.parametrize("a", [1])
async def test_one(a: int) -> None:
    def inner() -> None: ...

    // {mark} says-so
    #[test]
    fn two() {{
# {mark} nobody-s
"""
    expected = [("never-drops", "test_one"), ("says-so", "test_one"), ("says-so", "two")]
    assert marks(source) == [*expected, ("nobody-s", "")]


@pytest.mark.parametrize(
    ("held", "page", "wrong"),
    [
        ({"never-drops": ["a.py::b"]}, "**The player\nnever drops.** It has no queue.", []),
        ({}, "The player never drops.", ["never-drops: no test holds it"]),
        ({"never-drops": ["a.py::b"]}, "The player drops.",
         ["never-drops: playback.md does not say “The player never drops.”"]),
        ({"never-drops": ["a.py::b"], "other": ["a.py::c"]}, "The player never drops.",
         ["other: a.py::c holds a promise that nobody makes"]),
    ],
)  # fmt: skip
def test_what_is_wrong_is_a_sentence(
    held: dict[str, list[str]], page: str, wrong: list[str]
) -> None:
    assert faults([NEVER], held, {"playback.md": page}) == wrong


def test_promises_are_read_by_page() -> None:
    assert promises("playback.md:\n  never-drops: The player never drops.\n") == [NEVER]
