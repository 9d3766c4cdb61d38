"""`bagpipe list` and `bagpipe delete`: which results are where, and what goes with them."""

import contextlib
import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from bagpipe.cli import list as listing
from bagpipe.cli.__main__ import main
from bagpipe.cli.run_folder import run_folder
from bagpipe.cli.running import RunError
from bagpipe.report import stored
from bagpipe.storage import Storage
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish


def program(*words: str | Path, given: str | None = None) -> Any:
    done = CliRunner().invoke(main, list(map(str, words)), input=given)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done


def ended(folder: Path, moment: str) -> Path:
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["provenance"]["ended"] = moment
    path.write_text(json.dumps(manifest, indent=1))
    return folder


@pytest.fixture
def three(tmp_path: Path) -> dict[str, Path]:
    """Two jobs that ended, the later one failed, and one that runs."""
    made = {
        "old": ended(publish(tmp_path, [make_row("a-0000")], "uid-1"), "2026-11-20T04:00:00Z"),
        "new": ended(
            publish(tmp_path, [make_row("a-0000", "failed", "CriterionFailed")], "uid-2"),
            "2026-11-21T04:00:00Z",
        ),
    }
    made["runs"] = made["old"].parent / "uid-3"
    (made["runs"] / "journal").mkdir(parents=True)
    return made


def test_results_are_listed_newest_first(three: dict[str, Path], tmp_path: Path) -> None:
    done = program("list", tmp_path, "--output", "json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert [(Path(each["results"][7:]), each["verdict"], each["note"]) for each in found] == [
        (three["new"], "Failed", ""),
        (three["old"], "Passed", ""),
        (three["runs"], "", "it has no manifest: it runs, or was ended"),
    ]
    assert found[0]["counts"]["failed"] == 1
    table = program("list", three["old"])
    assert "2026-11-20T04:00:00Z" in table.stdout
    volume = ("--volume", f"results={tmp_path}")
    below = json.loads(program("list", "pvc://results/", *volume, "--output", "json").stdout)
    assert [each["verdict"] for each in below] == ["Failed", "Passed", ""]


def test_what_a_manifest_says_moves_no_cursor(three: dict[str, Path], tmp_path: Path) -> None:
    manifest = json.loads((three["old"] / "manifest.json").read_text())
    manifest["job"]["name"] = "\x1b[31m[red]"
    (three["old"] / "manifest.json").write_text(json.dumps(manifest))
    shown = program("list", tmp_path).stdout
    assert ("\x1b" in shown, "[31m" in shown) == (False, True)
    assert "\x1b" not in program("delete", three["old"], given="n\n").stderr


def test_folders_with_a_dot_are_looked_into(three: dict[str, Path], tmp_path: Path) -> None:
    (tmp_path / "v1.4").mkdir()
    three["old"].rename(tmp_path / "v1.4/lane")
    found = json.loads(program("list", tmp_path, "--output", "json").stdout)
    assert f"file://{tmp_path}/v1.4/lane" in [each["results"] for each in found]


def test_of_a_large_manifest_the_head_is_enough(
    three: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    manifest = three["old"] / "manifest.json"
    text = manifest.read_text()
    monkeypatch.setattr(stored, "_HEAD_BYTES", text.index('"cases": [') + 12)
    # What comes behind is not read, whatever it is.
    manifest.write_text(text[: text.index('"cases": [')] + '"cases": [' + "x" * 1000)
    (found,) = json.loads(program("list", three["old"], "--output", "json").stdout)
    assert (found["verdict"], found["note"]) == ("Passed", "")


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"job": 3}', "\x1b[31m"])
def test_a_manifest_that_is_none_is_named_and_hides_no_other(
    three: dict[str, Path], tmp_path: Path, text: str
) -> None:
    (three["new"] / "manifest.json").write_text(text)
    found = json.loads(program("list", tmp_path, "--output", "json").stdout)
    assert sorted(each["note"] for each in found) == [
        "",
        "it has no manifest: it runs, or was ended",
        "its manifest can't be read",
    ]


def test_a_folder_without_results_and_one_with_too_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "no results are there" in program("list", tmp_path).stdout
    for number in range(4):
        (tmp_path / str(number)).mkdir()
    monkeypatch.setattr(listing, "_MOST_FOLDERS", 4)
    done = program("list", tmp_path)
    assert (done.exit_code, "more than 4 folders" in done.stderr) == (2, True)


def test_what_a_job_left_is_removed_and_nothing_else(three: dict[str, Path]) -> None:
    folder = three["old"]
    (folder / "cases").mkdir(exist_ok=True)
    (folder / "cases/a-0000.bag").write_bytes(b"recorded")
    (folder / "notes.txt").write_text("mine")
    done = program("delete", folder, given="y\n")
    assert done.exit_code == 0, done.output
    assert "Remove it?" in done.stderr
    assert [path.name for path in folder.iterdir()] == ["notes.txt"]
    assert (three["new"] / "manifest.json").exists()
    done = program("delete", three["new"], "--yes")
    assert (done.exit_code, three["new"].exists()) == (0, False)


@pytest.mark.parametrize("answer", ["n\n", "\n", ""], ids=["no", "return", "nobody"])
def test_nothing_is_removed_without_a_yes(three: dict[str, Path], answer: str) -> None:
    done = program("delete", three["old"], given=answer)
    assert (done.exit_code, "nothing is removed" in done.stderr) == (2, True)
    assert (three["old"] / "manifest.json").exists()


def test_of_several_one_without_results_stops_all(three: dict[str, Path], tmp_path: Path) -> None:
    for other in (three["runs"], tmp_path / "nowhere"):
        done = program("delete", three["old"], other, "--yes")
        assert (done.exit_code, "has no manifest.json" in done.stderr) == (2, True)
        assert (three["old"] / "manifest.json").exists()


@pytest.mark.parametrize("where", ["the folder", "a claim's folder"])
def test_a_run_that_began_meanwhile_is_not_removed(
    three: dict[str, Path], monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    """`bagpipe run --replace` in another terminal, while this one waits for a yes."""
    folder = three["old"]
    (folder / "run.json").touch()
    manifest = (folder / "manifest.json").read_text()
    words: list[str | Path] = [folder]
    if where != "the folder":
        words = [f"pvc://results/{folder.name}", "--volume", f"results={folder.parent}"]
    with contextlib.ExitStack() as runs:

        def begins(*_: object, **_options: object) -> bool:
            runs.enter_context(run_folder(folder, {}, replace=True))
            (folder / "driver.log").touch()
            (folder / "manifest.json").write_text(manifest)
            return True

        monkeypatch.setattr("click.confirm", begins)
        done = program("delete", *words)
        assert (done.exit_code, "another run is writing into" in done.stderr) == (2, True)
        assert "--results" not in done.stderr
        left = {path.name for path in folder.iterdir()}
        assert left == {"run.json", "driver.log", "manifest.json"}
        with pytest.raises(RunError, match="another run is writing into"):
            runs.enter_context(run_folder(folder, {}, replace=True))


def test_other_results_than_those_that_were_shown_are_not_removed(
    three: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = three["old"]
    monkeypatch.setattr("click.confirm", lambda *_, **__: ended(folder, "2026-11-22T04:00:00Z"))
    done = program("delete", folder)
    assert (done.exit_code, "other results than those that were shown" in done.stderr) == (2, True)
    assert (folder / "manifest.json").exists()


def test_no_run_begins_while_results_are_removed(
    three: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = three["old"]
    (folder / "run.json").touch()
    removed: list[str] = []
    remove = Storage.remove

    def removes(storage: Storage, uri: str) -> None:
        with pytest.raises(RunError), run_folder(folder, {}, replace=True):
            pass
        remove(storage, uri)
        removed.append(uri)

    monkeypatch.setattr(Storage, "remove", removes)
    done = program("delete", folder, "--yes")
    assert done.exit_code == 0, done.stderr
    assert len(removed) > 2
    assert not folder.exists()


def test_the_manifest_goes_last(three: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    removed: list[str] = []
    monkeypatch.setattr("bagpipe.storage.Storage.remove", lambda _, uri: removed.append(uri))
    program("delete", three["old"], "--yes")
    assert removed[-1].endswith("/manifest.json")
    assert sum(each.endswith("/manifest.json") for each in removed) == 1
    assert any(each.endswith("/results.jsonl") for each in removed)
