"""The one version number, in the file VERSION, and every other place that repeats it.

    python3 -m release.version           say which places disagree; 1 if any does
    python3 -m release.version 0.3.0     write this number into VERSION and into all of them

Packages, crates, charts and manifests are read by programs that know no other file than their own,
so each has the number in writing. `make version` calls it with VERSION=.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from release import ReleaseError

ROOT = Path(__file__).resolve().parents[1]
NUMBER = r"\d+\.\d+\.\d+(?:-[0-9A-Za-z.]+)?"
# Each is a file, and what stands before the number there.
PLACES = {
    "pyproject.toml": r'^version = "',
    "images/spark/pyproject.toml": r'^version = "',
    "operator/pyproject.toml": r'^version = "',
    "images/agent/crates/python/pyproject.toml": r'^version = "',
    "images/agent/Cargo.toml": r'^version = "',
    "images/agent/Cargo.lock": r'^name = "bagpipe-[a-z0-9]+"\nversion = "',
    "images/agent/fuzz/Cargo.lock": r'^name = "bagpipe-(?!fuzz)[a-z0-9]+"\nversion = "',
    "images/spark/src/bagpipe/__init__.py": r'^__version__ = "',
    "images/spark/src/bagpipe/binpipe/session.py": r'"bagpipe-binpipe python ',
    "images/spark/sdk/cpp/binpipe.hpp": r'"bagpipe-binpipe c\+\+ ',
    "images/agent/crates/agent/metrics.txt": r'^bagpipe_agent_info\{version="',
    "tests/integration/kubectl_plugin/test_launcher.py": r"kubectl bagpipe, version ",
    "uv.lock": r'^name = "bagpipe(?:-operator|-workspace)?"\nversion = "',
    "charts/bagpipe/Chart.yaml": r'^(?:version: |appVersion: ")',
    "charts/bagpipe-namespace/Chart.yaml": r'^(?:version: |appVersion: ")',
    "tests/unit/chart/rendered.yaml": r'(?:app\.kubernetes\.io/version: "?|chart: bagpipe-)',
}
# In any other file of the project: an image of ours, and the plugin's archive.
ANYWHERE = r"(?:bagpipe\.local/[a-z0-9-]+:|kubectl-bagpipe-v)"
# What was released before stays as it was, and a test of the chart has a number of its own.
PAST = ("tests/e2e/previous/", "CHANGELOG.md", "charts/bagpipe/tests/")


@dataclass(frozen=True)
class Place:
    """A place that repeats the number: its file, its line and what it says."""

    file: str
    line: int
    number: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line} says {self.number}"


def version() -> str:
    """The number of this checkout."""
    found = (ROOT / "VERSION").read_text().strip()
    if not re.fullmatch(NUMBER, found):
        raise ReleaseError(f"VERSION says {found!r}, which is no version such as 0.2.0.")
    return found


def texts() -> Iterator[tuple[str, str, str]]:
    """Each file that repeats the number: its path, its text, and what stands before the number."""
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in listed.stdout.rstrip("\0").split("\0"):
        if name.startswith(PAST) or not (ROOT / name).is_file():
            continue
        try:
            text = (ROOT / name).read_text()
        except UnicodeDecodeError:
            continue
        own = PLACES.get(name)
        yield name, text, f"(?:{own}|{ANYWHERE})" if own else ANYWHERE


def places() -> list[Place]:
    """All places. Raises ReleaseError for a file that ought to have the number and has none."""
    found = []
    without = set(PLACES)
    for name, text, before in texts():
        for match in re.finditer(f"{before}({NUMBER})", text, re.MULTILINE):
            found.append(Place(name, text.count("\n", 0, match.start(1)) + 1, match[1]))
            without.discard(name)
    if without:
        raise ReleaseError(f"No version is found any more in {', '.join(sorted(without))}.")
    return found


def write(number: str) -> list[str]:
    """Write a number into all places; the files that changed. Raises ReleaseError."""
    if not re.fullmatch(NUMBER, number):
        raise ReleaseError(f"{number!r} is no version: three numbers, such as 0.2.0.")
    changed = []
    (ROOT / "VERSION").write_text(f"{number}\n")
    for name, text, before in texts():
        new = re.sub(f"({before}){NUMBER}", rf"\g<1>{number}", text, flags=re.MULTILINE)
        if new != text:
            (ROOT / name).write_text(new)
            changed.append(name)
    return changed


def main(words: list[str]) -> int:
    try:
        if words:
            print(f"{words[0]} is in VERSION and {len(write(words[0]))} other files now.")
            return 0
        own = version()
        others = [each for each in places() if each.number != own]
    except ReleaseError as error:
        print(error, file=sys.stderr)
        return 1
    for each in others:
        print(f"{each}, and VERSION says {own}.", file=sys.stderr)
    return bool(others)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
