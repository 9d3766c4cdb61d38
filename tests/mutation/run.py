"""Break one line after another, and say which breaks no unit test notices.

    python -m tests.mutation.run [FILE...] [--tests TEST...]

Each FILE is a module whose decisions matter; without one those of deciders.toml are meant, which
also names their tests, and less than 85 % killed of any is a failure. cosmic-ray makes the mutants,
in a copy of the project, and each meets the unit tests that import the module until one fails:
those of its name first, then the nearest. A mutant that none kills is shown as it differs: a test
is missing, or the line says nothing.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterable
from pathlib import Path

from tests.cached import cache
from tests.quick.affected import affected, read

ROOT = Path(__file__).parents[2]
CACHE = cache() / "mutation"
LEAST_PERCENT = 85
# What runs the tests ends one that hangs, long before.
MUTANT_SECONDS = 3600
# What says nothing: `|` is mostly a type's, operators on numbers have nearer neighbours, and `is`
# of two numbers or texts is an accident, as the order of two words is.
LEFT_OUT = [
    "core/ReplaceBinaryOperator_BitOr_.*",
    "core/ReplaceBinaryOperator_.*_(Pow|RShift|LShift|BitOr|BitAnd|BitXor|FloorDiv|Mod|Div)",
    "core/ReplaceComparisonOperator_.*_(Is|IsNot)",
    "core/ReplaceComparisonOperator_(Eq|NotEq)_(Lt|LtE|Gt|GtE)",
    "core/RemoveDecorator",
    "core/VariableReplacer",
    "core/VariableInserter",
]
# No mutant of this can be noticed: mypy proves that nobody writes to one.
FROZEN = "-@dataclass(frozen=True)\n"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="*", metavar="FILE")
    parser.add_argument("--tests", nargs="*", metavar="TEST", help="instead of the known ones")
    given = parser.parse_args()
    programs = _installed()
    known = deciders()
    status = 0
    for file in given.files or known:
        tests = given.tests or known.get(file) or nearest(Path(file))
        if not tests:
            print(f"{file}: no unit test imports it: name some by --tests")
            status = 1
            continue
        begun = time.monotonic()
        with tempfile.TemporaryDirectory(dir=CACHE) as folder:
            results = _mutants(programs, Path(folder), file, tests)
        killed, survivors = judged(results)
        print(
            f"{file}: {killed} of {killed + len(survivors)} killed "
            f"({share(killed, len(survivors))}), by {len(tests)} files of tests, "
            f"{time.monotonic() - begun:.0f} s",
            flush=True,
        )
        for survivor in survivors:
            print(survivor)
        if not given.files and not enough(killed, len(survivors)):
            print(f"{file}: fewer than {LEAST_PERCENT} % were killed", flush=True)
            status = 1
    return status


def deciders() -> dict[str, list[str]]:
    """The modules that are looked at each night, with their tests."""
    parts = tomllib.loads(Path(__file__).with_name("deciders.toml").read_text())
    return {file: tests for part in parts.values() for file, tests in part.items()}


def enough(killed: int, survived: int) -> bool:
    """Whether so many of a module's mutants were killed as must be (issue 14); none is too few."""
    return killed > 0 and 100 * killed >= LEAST_PERCENT * (killed + survived)


def nearest(file: Path) -> list[str]:
    """The unit tests that import a file, those first that are likely to fail with it."""
    found = affected(read(ROOT), [file])
    by_name = sorted(found, key=lambda test: (file.stem not in test.stem, found[test], test))
    return [str(test) for test in by_name]


def configuration(file: str, command: str) -> str:
    """cosmic-ray's, as TOML; texts of TOML and JSON are written alike."""
    return "\n".join(
        [
            "[cosmic-ray]",
            f"module-path = {json.dumps(file)}",
            f"timeout = {MUTANT_SECONDS}.0",
            "excluded-modules = []",
            f"test-command = {json.dumps(command)}",
            "[cosmic-ray.distributor]",
            'name = "local"',
            "[cosmic-ray.filters.operators-filter]",
            f"exclude-operators = {json.dumps(LEFT_OUT)}",
        ]
    )


def judged(dump: Iterable[str]) -> tuple[int, list[str]]:
    """How many mutants of a session's dump were killed, and the others as they differ."""
    killed, survivors = 0, []
    for line in dump:
        _, result = json.loads(line)
        if result is None or result["worker_outcome"] == "skipped" or FROZEN in result["diff"]:
            continue
        if result["test_outcome"] == "survived":
            survivors.append(result["diff"])
        else:
            killed += 1
    return killed, survivors


def share(killed: int, survived: int) -> str:
    """In percent, rounded down, so that 100 % is all of them."""
    return f"{100 * killed // max(1, killed + survived)} %"


def _installed() -> Path:
    """cosmic-ray in an environment of its own, as uv.lock has it."""
    lock = subprocess.run(
        [ROOT / ".venv/bin/uv", "export", "--quiet", "--frozen", "--only-group", "mutation"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    CACHE.mkdir(parents=True, exist_ok=True)
    # In the environment, so that one that was removed is not taken for there.
    venv, kept = CACHE / "venv", CACHE / "venv" / "requirements.txt"
    if not kept.exists() or kept.read_text() != lock:
        subprocess.run([sys.executable, "-m", "venv", "--clear", venv], check=True)
        wanted = CACHE / "requirements.partly.txt"
        wanted.write_text(lock)
        pip = [str(venv / "bin/pip"), "install", "--quiet", "--require-hashes", "-r", str(wanted)]
        subprocess.run(pip, check=True)
        wanted.rename(kept)
    return venv / "bin"


def _mutants(programs: Path, folder: Path, file: str, tests: list[str]) -> list[str]:
    """The dump of a session in a copy of what git knows or could know."""
    _copy_into(folder)
    python, warm = f"{ROOT}/.venv/bin/python", "tests/mutation/warm.py"
    (folder / "mutation.toml").write_text(configuration(file, f"{python} -I -S {warm} warm.sock"))

    def run(program: str, *words: str) -> str:
        done = subprocess.run(
            [programs / program, *words], cwd=folder, stdout=subprocess.PIPE, text=True, check=True
        )
        return done.stdout

    # Else the project would be what is installed.
    environment = os.environ | {"PYTHONPATH": "images/spark/src:operator/src"}
    with (folder / "tests.log").open("w") as log:
        tested = subprocess.Popen(
            [python, warm, "warm.sock", *tests], cwd=folder, env=environment, stdout=log
        )
    try:
        while not (folder / "warm.sock").exists():  # the tests as they are: most take seconds
            if tested.poll() is not None:
                raise SystemExit(f"{(folder / 'tests.log').read_text()}{file}: its tests fail")
            time.sleep(0.1)
        run("cosmic-ray", "init", "mutation.toml", "session.sqlite")
        run("cr-filter-operators", "session.sqlite", "mutation.toml")
        run("cosmic-ray", "exec", "mutation.toml", "session.sqlite")
        if tested.poll() is not None:  # then it answered nothing, and all would count as killed
            raise SystemExit(f"{file}: what runs the tests ended: {tested.returncode}")
        return run("cosmic-ray", "dump", "session.sqlite").splitlines()
    finally:
        tested.kill()
        tested.wait()


def named_by_git() -> list[str]:
    """The files that git knows or could know; some may have been deleted."""
    names = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    return [name for name in names.split("\0") if name]


def _copy_into(folder: Path) -> None:
    for name in named_by_git():
        if (ROOT / name).is_file():  # one that was deleted is in the index still
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)


if __name__ == "__main__":
    sys.exit(main())
