"""Break one place of the agent after another, and say which breaks no unit test notices.

    python -m tests.mutation.rust [FILE...] [--part K/N]

Each FILE is one of rust_deciders.toml; without one all of them are meant, and less than 85 % killed
of any is a failure. cargo-mutants makes the mutants, in a copy of the project that stays in the
cache, so that a mutant costs the build of one crate. Each meets that crate's unit tests, which are
in memory and on a clock moved by hand; its tests with nodes and sockets are left out. One that
runs out of time counts as one that survived, until somebody has looked whether it ever ends.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from tests.mutation.run import CACHE, LEAST_PERCENT, ROOT, enough, named_by_git, share

VERSION = "27.1.0"
AGENT = "images/agent"
COPY, TARGET, REPORT = CACHE / "rust", CACHE / "rust-target", CACHE / "rust-report"
# What it exits with where all was tried: all were killed, some survived, some ran out of time.
TRIED = {0, 2, 3}
# One that ran out of time was noticed by nobody: it may never end, or the machine stood still.
SURVIVED = {"MissedMutant", "Timeout"}
# Of the tests as they are, whose time the same machine needed; a minute where they took less.
TIMES_LONGER, LEAST_SECONDS = 10, 60
# A mutant is compiled far more often than it computes: nothing is optimised, nothing debugged.
UNOPTIMISED = {"CARGO_PROFILE_DEV_OPT_LEVEL": "0", "CARGO_PROFILE_DEV_DEBUG": "0"}
NO_PACKAGE_EITHER = 'profile.dev.package."*".opt-level=0'


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="*", metavar="FILE")
    parser.add_argument("--part", metavar="K/N", help="only one of N parts, from 0/N on")
    given = parser.parse_args()
    try:
        wanted = chosen(given.files, deciders())
    except ValueError as error:
        parser.error(str(error))
    _installed()
    mirror(ROOT, [name for name in named_by_git() if name.startswith(AGENT)], COPY)
    status = 0
    for crate, files in wanted.items():
        for file, (counts, survivors) in judged(_mutants(crate, files, given.part)).items():
            print(line(file, counts))
            print("".join(f"  {name}\n" for name in survivors), end="", flush=True)
            if not given.files and not given.part and not enough(killed(counts), len(survivors)):
                print(f"{file}: fewer than {LEAST_PERCENT} % were killed", flush=True)
                status = 1
    return status


def deciders() -> dict[str, list[str]]:
    """The files that are looked at each night, by crate."""
    known: dict[str, list[str]] = tomllib.loads(
        Path(__file__).with_name("rust_deciders.toml").read_text()
    )
    return known


def chosen(files: list[str], known: dict[str, list[str]]) -> dict[str, list[str]]:
    """Those of the known files that are asked for, or all. Raises ValueError."""
    asked = {file.removeprefix(f"{AGENT}/") for file in files}
    if unknown := asked - {file for of_crate in known.values() for file in of_crate}:
        raise ValueError(f"not in rust_deciders.toml: {', '.join(sorted(unknown))}")
    found = {
        crate: [each for each in of if each in asked or not asked] for crate, of in known.items()
    }
    return {crate: of for crate, of in found.items() if of}


def judged(outcomes: Iterable[dict[str, Any]]) -> dict[str, tuple[Counter[str], list[str]]]:
    """How many mutants of each file came to what, and the names of those that survived."""
    found: dict[str, tuple[Counter[str], list[str]]] = {}
    for outcome in outcomes:
        scenario = outcome["scenario"]
        if scenario == "Baseline":
            continue
        mutant, summary = scenario["Mutant"], outcome["summary"]
        counts, survivors = found.setdefault(mutant["file"], (Counter(), []))
        counts[summary] += 1
        if summary in SURVIVED:
            late = " (ran out of time)" if summary == "Timeout" else ""
            survivors.append(f"{mutant['name']}{late}")
    return found


def killed(counts: Counter[str]) -> int:
    """Mutants that a test noticed."""
    return counts["CaughtMutant"]


def line(file: str, counts: Counter[str]) -> str:
    """A file's figures in words; mutants that do not compile are no mutants."""
    missed = sum(counts[summary] for summary in SURVIVED)
    return (
        f"{file}: {killed(counts)} of {killed(counts) + missed} killed"
        f" ({share(killed(counts), missed)}), {counts['Timeout']} ran out of time,"
        f" {counts['Unviable']} do not compile"
    )


def mirror(source: Path, names: list[str], copy: Path) -> None:
    """Make a copy what the named files are.

    What is the same keeps its time, so that cargo does not build it again; what a run that was cut
    off left broken is written again.
    """
    wanted = {name for name in names if (source / name).is_file()}
    for there in [path for path in copy.rglob("*") if path.is_file() or path.is_symlink()]:
        if str(there.relative_to(copy)) not in wanted:
            there.unlink()
    for name in wanted:
        data, target = (source / name).read_bytes(), copy / name
        if not target.is_file() or target.read_bytes() != data:
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)


def command(crate: str, files: list[str], part: str | None) -> list[str]:
    """What breaks these files of a crate, in the copy itself."""
    words = ["cargo", "mutants", "--in-place", "--dir", str(COPY / AGENT), "--package", crate]
    words += ["--output", str(REPORT), "--no-shuffle", "--colors", "never"]
    words += ["--timeout-multiplier", str(TIMES_LONGER)]
    words += ["--minimum-test-timeout", str(LEAST_SECONDS)]
    words += [word for file in files for word in ("--file", file)]
    words += [
        f"--cargo-arg={word}" for word in ("--lib", "--locked", f"--config={NO_PACKAGE_EITHER}")
    ]
    return words + (["--shard", part] if part else [])


def _mutants(crate: str, files: list[str], part: str | None) -> list[dict[str, Any]]:
    shutil.rmtree(REPORT, ignore_errors=True)
    REPORT.mkdir(parents=True)
    environment = os.environ | UNOPTIMISED | {"CARGO_TARGET_DIR": str(TARGET)}
    done = subprocess.run(command(crate, files, part), env=environment, check=False)
    if done.returncode not in TRIED:
        raise SystemExit(f"cargo mutants failed: {done.returncode}; its logs are in {REPORT}")
    report = json.loads((REPORT / "mutants.out" / "outcomes.json").read_text())
    outcomes: list[dict[str, Any]] = report["outcomes"]
    return outcomes


def _installed() -> None:
    found = subprocess.run(
        ["cargo", "mutants", "--version"], capture_output=True, text=True, check=False
    ).stdout.strip()
    if found != f"cargo-mutants {VERSION}":
        raise SystemExit(
            f"cargo-mutants {VERSION} is missing:"
            f" cargo install cargo-mutants --locked --version {VERSION}"
        )


if __name__ == "__main__":
    sys.exit(main())
