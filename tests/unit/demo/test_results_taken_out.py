"""The demonstration ends with a folder and a page to look at, or says why there is none."""

import re
from pathlib import Path

import pytest

from tests.e2e import demo
from tests.e2e import kubectl as k

URI = "pvc://results/demo/robot-state-publisher/0c1f"
# In place of the cluster: as `kubectl cp` is called, with the words of its own in $1 to $3.
COPIES = 'test "$1" = cp && mkdir "$3" && for f in {files}; do echo "$2" > "$3/$f"; done'


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("BAGPIPE_CACHE", str(tmp_path))
    (tmp_path / "bin/tools").mkdir(parents=True)
    return tmp_path


def pretend(cache: Path, script: str) -> None:
    """A kubectl that does this, where the project's own is found first."""
    program = cache / "bin/tools/kubectl"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)


def test_the_results_are_copied_and_named(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = cache / "demo/robot-state-publisher"
    folder.mkdir(parents=True)
    (folder / "of-an-earlier-demo").touch()
    pretend(cache, COPIES.format(files="manifest.json report.html"))
    demo.take_out(URI)
    assert {path.name for path in folder.iterdir()} == {"manifest.json", "report.html"}
    source = (folder / "report.html").read_text().strip()
    assert source == "default/toolbox:/results/demo/robot-state-publisher/0c1f"
    output = capsys.readouterr().out
    assert f"$ .venv/bin/bagpipe results {folder}\n" in output
    assert re.search(rf"browser: {folder}/report.html$", output, re.MULTILINE)


@pytest.mark.parametrize(
    ("script", "why"),
    [
        ("echo error: unable to upgrade connection >&2; exit 1", "unable to upgrade connection"),
        (COPIES.format(files="manifest.json"), "left no report.html"),
        ("exit 0", "left no manifest.json and no report.html"),
    ],
    ids=["refused", "half", "empty"],
)
def test_a_copy_that_fails_is_reported_and_is_no_verdict(
    cache: Path, capsys: pytest.CaptureFixture[str], script: str, why: str
) -> None:
    pretend(cache, script)
    demo.take_out(URI)
    output = capsys.readouterr().out
    folder = cache / "demo/robot-state-publisher"
    assert f"could not be copied to {folder}: " in output
    assert why in output
    assert f"Try: kubectl cp {k.on_claim('default', URI)} {folder}" in output
    assert "bagpipe results" not in output
