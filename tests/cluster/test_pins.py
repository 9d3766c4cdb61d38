"""Packages ask for ranges, `uv.lock` has the exact versions, and images install just these."""

from __future__ import annotations

import os
import re
import subprocess
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import context
import pytest
from context import ROOT
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

PACKAGES = [ROOT / name for name in ("pyproject.toml", "images/spark/pyproject.toml",
                                     "operator/pyproject.toml")]  # fmt: skip
BUILT = [*PACKAGES[1:], ROOT / "images/agent/crates/python/pyproject.toml"]
# Why a version is the one that is wanted, and no range of them.
EXACT = {
    "grafana-foundation-sdk": "each release is of one Grafana, and the dashboards are of 11.6",
}
# They are released as one, from one checkout, and have no versions of each other to choose from.
OURS = {"bagpipe", "bagpipe-operator"}
# A module's releases are numbered by days or by what they hold, or break nothing by their majors.
UNBOUNDED = {"fsspec", "pyarrow", "tzdata"}
PINNED = re.compile(r"^([A-Za-z0-9._-]+)==([^ ;]+)")


def locked() -> dict[str, dict[str, Any]]:
    """What the lock has of each package; a name has but one version in it."""
    found = tomllib.loads((ROOT / "uv.lock").read_text())["package"]
    return {str(each["name"]): each for each in found}


def required(pyproject: Path) -> Iterator[Requirement]:
    """All that a package, its extras and its groups ask for."""
    read = tomllib.loads(pyproject.read_text())
    project = read["project"]
    lists = [
        project.get("dependencies", []),
        *project.get("optional-dependencies", {}).values(),
        *read.get("dependency-groups", {}).values(),
    ]
    for each in (each for listed in lists for each in listed if isinstance(each, str)):
        found = Requirement(each)
        if found.name not in OURS:
            yield found


def bounds(requirement: Requirement) -> dict[str, Version]:
    return {each.operator: Version(each.version) for each in requirement.specifier}


@pytest.mark.parametrize("pyproject", PACKAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_package_asks_for_ranges_that_begin_with_what_was_tested(pyproject: Path) -> None:
    asked = list(required(pyproject))
    assert asked
    for each in asked:
        if each.name in EXACT:
            assert set(bounds(each)) == {"=="}, each
            continue
        assert set(bounds(each)) <= {">=", "<"}, f"{each}: exact versions are in uv.lock alone"
        assert ">=" in bounds(each), f"{each}: write from which version on it is tested"
        version = Version(locked()[canonicalize_name(each.name)]["version"])
        assert each.specifier.contains(version, prereleases=True), f"{each}: the lock has {version}"


@pytest.mark.parametrize("pyproject", PACKAGES[1:], ids=lambda path: str(path.relative_to(ROOT)))
def test_what_users_install_ends_before_the_next_release_that_may_break_it(pyproject: Path) -> None:
    for each in required(pyproject):
        assert ("<" in bounds(each)) == (each.name not in UNBOUNDED), each


def test_what_makes_wheels_is_the_lock_s() -> None:
    # What an isolated build fetches is in no lock: pip and uv take what is written here.
    for pyproject in BUILT:
        for each in tomllib.loads(pyproject.read_text())["build-system"]["requires"]:
            name, _, version = each.partition("==")
            assert locked()[name]["version"] == version, f"{pyproject}: {each}"


def test_the_lock_is_of_these_ranges(tmp_path: Path) -> None:
    # Without a network, and without what an earlier look has kept.
    done = subprocess.run(
        [context.tool("uv"), "lock", "--check", "--offline"], cwd=ROOT, capture_output=True,
        text=True, timeout=120, check=False, env={**os.environ, "UV_CACHE_DIR": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, f"run `.venv/bin/uv lock`: {done.stderr}"


def spark(folder: Path) -> list[Path]:
    context.stage_spark(folder)
    return [folder / "requirements.txt", folder / "build-requirements.txt"]


def operator(folder: Path) -> list[Path]:
    context.stage_operator(folder)
    return [folder / "requirements.txt"]


@pytest.mark.parametrize(("stage", "package", "extras"), [
    (spark, "images/spark", ("spark", "storage")), (operator, "operator", ()),
], ids=["spark", "operator"])  # fmt: skip
def test_an_image_installs_the_lock_s_versions_by_the_lock_s_hashes(
    stage: Callable[[Path], list[Path]], package: str, extras: tuple[str, ...], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    # No wheels of ours: they bring nothing with them, as pip gets --no-deps for them.
    for name in ("package", "memory_bag"):
        monkeypatch.setattr(context, name, lambda *_: None)
    lock, installed = locked(), set()
    for file in stage(tmp_path):
        for line in file.read_text().replace("\\\n", " ").splitlines():
            if not line.strip() or line.lstrip().startswith("#"):
                continue
            found = PINNED.match(line)
            assert found, line
            entry = lock[canonicalize_name(found[1])]
            assert entry["version"] == found[2], line
            files = [*entry.get("wheels", []), *([entry["sdist"]] if "sdist" in entry else [])]
            known = {each["hash"] for each in files}
            hashes = set(re.findall(r"--hash=(\S+)", line))
            assert hashes, line
            assert hashes <= known, line
            installed.add(canonicalize_name(found[1]))
    wanted = needed(package, extras)
    assert len(wanted) > 10
    assert wanted <= installed


def needed(package: str, extras: tuple[str, ...]) -> set[str]:
    """What our own wheels ask for directly, which must be listed: they bring nothing with them."""
    project = tomllib.loads((ROOT / package / "pyproject.toml").read_text())["project"]
    lists = [project["dependencies"], *(project["optional-dependencies"][e] for e in extras)]
    found: set[str] = set()
    for each in (Requirement(each) for listed in lists for each in listed):
        if each.name == "bagpipe":
            found |= needed("images/spark", tuple(each.extras))
        else:
            found.add(canonicalize_name(each.name))
    return found


@pytest.mark.parametrize("name", ["spark", "operator"])
def test_our_own_wheels_bring_nothing_into_an_image(name: str) -> None:
    text = (ROOT / f"images/{name}/Dockerfile").read_text().replace("\\\n", " ")
    words = [each for each in re.findall(r"pip install ([^&|;\n]*)", text) if ".whl" in each]
    assert words
    for each in words:
        assert {"--no-deps", "--no-index"} <= set(each.split()), each
