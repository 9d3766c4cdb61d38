"""One version number, in VERSION: whatever repeats it agrees, and one command changes it."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

import bagpipe
from bagpipe_operator.settings import Settings
from release import ReleaseError, version

ROOT = Path(__file__).parents[3]


def test_no_place_disagrees() -> None:
    own = version.version()
    assert [str(each) for each in version.places() if each.number != own] == []


def test_programs_and_charts_have_the_number() -> None:
    own = version.version()
    assert bagpipe.__version__ == own
    assert Settings.__dataclass_fields__["agent_image"].default == f"bagpipe.local/agent:{own}"
    for chart in ("bagpipe", "bagpipe-namespace"):
        described = yaml.safe_load((ROOT / "charts" / chart / "Chart.yaml").read_text())
        assert (described["version"], described["appVersion"]) == (own, own)
    answer = subprocess.run(
        ["cargo", "metadata", "--format-version=1", "--no-deps", "--offline", "--locked"],
        cwd=ROOT / "images/agent", capture_output=True, text=True, timeout=60, check=True,
    ).stdout  # fmt: skip
    crates = {each["version"] for each in json.loads(answer)["packages"]}
    assert crates == {own}


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of all files that repeat the number, as a checkout of its own."""
    for each in {place.file for place in version.places()} | {"VERSION"}:
        (tmp_path / each).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / each, tmp_path / each)
    for command in (["init", "--quiet"], ["add", "--all"]):
        subprocess.run(["git", *command], cwd=tmp_path, check=True, timeout=60)
    monkeypatch.setattr(version, "ROOT", tmp_path)
    return tmp_path


@pytest.mark.usefixtures("checkout")
def test_one_command_writes_another_number_everywhere() -> None:
    before = version.places()
    assert len(before) > 100
    changed = version.write("7.8.9")
    after = version.places()
    assert [(p.file, p.line) for p in after] == [(p.file, p.line) for p in before]
    assert {p.number for p in after} == {version.version()} == {"7.8.9"}
    assert set(changed) == {p.file for p in after}
    assert version.main([]) == 0


def test_a_place_that_disagrees_is_named(
    checkout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = checkout / "docs/examples/barrier-car/job.yaml"
    own, before = version.version(), job.read_text().splitlines()
    (line,) = [i for i, text in enumerate(before, 1) if f"/barrier-car:{own}" in text]
    job.write_text(job.read_text().replace(f"/barrier-car:{own}", "/barrier-car:0.0.7"))
    assert version.main([]) == 1
    answer = capsys.readouterr().err
    assert answer == f"{job.relative_to(checkout)}:{line} says 0.0.7, and VERSION says {own}.\n"


def test_a_file_in_which_no_number_is_found_is_named(checkout: Path) -> None:
    (checkout / "operator/pyproject.toml").write_text("[project]\n")
    with pytest.raises(ReleaseError, match=r"any more in operator/pyproject\.toml\."):
        version.places()


@pytest.mark.usefixtures("checkout")
@pytest.mark.parametrize("wrong", ["", "v1.0.0", "1.0", "1.0.0; true"])
def test_what_is_no_version_is_refused(wrong: str) -> None:
    own = version.version()
    with pytest.raises(ReleaseError, match="is no version: three numbers"):
        version.write(wrong)
    assert version.version() == own
