"""Writes docs/reference/promises.md: each promise of the documentation with the tests that hold it.

.venv/bin/python -m tests.promises.page           write it
.venv/bin/python -m tests.promises.page --check   say whether it is up to date

Both fail where a promise has no test, a test names a promise that nobody makes, or a page does not
say it in these words any more.
"""

import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import yaml

from docs.site.generated import keep

ROOT = Path(__file__).parents[2]
PROMISES = Path(__file__).with_name("promises.yaml")
PAGE = ROOT / "docs/reference/promises.md"
TESTS = ("tests/**/test_*.py", "images/agent/crates/**/*.rs")
_MARK = re.compile(r"^\s*(?:#|//) Promise: (.+)$")
_TEST = re.compile(r"^\s*(?:async )?(?:def|fn) (\w+)")
HEAD = """\
# Promises, and the tests that hold them

What these pages promise, in their own words, and the tests that fail when it is broken. Written
by `python -m tests.promises.page` from the lines `Promise: …` above the tests; `make docs` fails
for a promise without a test. The threat model has [a table of its
own](../operations/threat-model.md).
"""


@dataclass(frozen=True)
class Promise:
    """A sentence of a page."""

    name: str
    page: str
    words: str


def promises(text: str) -> list[Promise]:
    """Those of a file such as promises.yaml."""
    return [
        Promise(name, page, words)
        for page, named in yaml.safe_load(text).items()
        for name, words in named.items()
    ]


def marks(source: str) -> list[tuple[str, str]]:
    """Each promise that a test file names, with the test that follows."""
    found, waiting = [], []
    for line in source.splitlines():
        if marked := _MARK.match(line):
            waiting += [name.strip() for name in marked[1].split(",")]
        elif waiting and (test := _TEST.match(line)):
            found += [(name, test[1]) for name in waiting]
            waiting = []
    return found + [(name, "") for name in waiting]


def faults(
    made: Iterable[Promise], held: Mapping[str, list[str]], pages: Mapping[str, str]
) -> list[str]:
    """What is wrong, a sentence each; `held` are the tests of each name."""
    made = list(made)
    known = {promise.name for promise in made}
    wrong = [f"{name}: {held[name][0]} holds a promise that nobody makes"
             for name in sorted(held) if name not in known]  # fmt: skip
    for promise in made:
        if promise.name not in held:
            wrong.append(f"{promise.name}: no test holds it")
        if _one_line(promise.words) not in _one_line(pages[promise.page]):
            wrong.append(f"{promise.name}: {promise.page} does not say “{promise.words}”")
    return wrong


def _one_line(text: str) -> str:
    return re.sub(r"[\s*]+", " ", text)


def page(made: Iterable[Promise], held: Mapping[str, list[str]]) -> str:
    """The whole page."""
    lines, of = [HEAD.rstrip("\n")], ""
    for promise in made:
        if promise.page != of:
            of = promise.page
            lines += ["", f"## [{of}](../{of})", "", "| promise | held by |", "|---|---|"]
        tests = ", ".join(f"`{test}`" for test in held[promise.name])
        lines.append(f"| {promise.words} | {tests} |")
    return "\n".join(lines) + "\n"


def held_by_tests() -> dict[str, list[str]]:
    """The tests of each name, as FILE::TEST."""
    held: dict[str, list[str]] = {}
    for path in sorted(path for pattern in TESTS for path in ROOT.glob(pattern)):
        for name, test in marks(path.read_text()):
            held.setdefault(name, []).append(f"{path.relative_to(ROOT)}::{test}")
    return held


def main(words: list[str]) -> int:
    """0 where all is well."""
    made, held = promises(PROMISES.read_text()), held_by_tests()
    pages = {promise.page: (ROOT / "docs" / promise.page).read_text() for promise in made}
    if wrong := faults(made, held, pages):
        print("\n".join(wrong), file=sys.stderr)
        return 1
    return keep(PAGE, page(made, held), "tests.promises.page", words)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
