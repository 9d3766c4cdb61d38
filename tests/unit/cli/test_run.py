"""`bagpipe run` before anything runs: refusals, and the folder of the results."""

import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from bagpipe.cli import run as module
from bagpipe.cli.__main__ import main
from bagpipe.cli.running import RunError
from bagpipe.run.laptop import agent_program
from tests.unit.bagpipe.jobs import make_row, make_spec
from tests.unit.report.publishing import publish

SPEC = {
    "source": {"files": ["pvc://recordings/*.bin"]},
    "stack": {"image": "i", "command": ["true"], "engine": "exec"},
    "output": {"uri": "pvc://results/out"},
}


def run(folder: Path, *arguments: str, **changed: object) -> tuple[int, str]:
    job = {
        "apiVersion": "sim.bagpipe.io/v1alpha1",
        "kind": "SimulationJob",
        "metadata": {"name": "lane"},
        "spec": SPEC | changed,
    }
    (folder / "job.yaml").write_text(yaml.safe_dump(job))
    volume = ["--volume", f"recordings={folder}", "--results", str(folder / "kept")]
    # Any program may stand for the agent where it is never reached.
    words = ["run", str(folder / "job.yaml"), *volume, "--agent", "true", *arguments]
    ended = CliRunner().invoke(main, words)
    assert ended.exception is None or isinstance(ended.exception, SystemExit), ended.exception
    return ended.exit_code, ended.output


@pytest.mark.parametrize(
    ("arguments", "changed", "sentence"),
    [
        (["--agent", "no-such-agent"], {}, "there is no no-such-agent on this machine"),
        (["--resume", "--replace"], {}, "write one of them"),
        (["--slots", "65"], {}, "65 is not in the range 1<=x<=64"),
        (["--volume", "recordings=/nowhere"], {}, "write the claim's name, =, and a folder"),
        (["--variant", "x"], {}, "the job's variants are none"),
        ([], {"resumeFrom": "x"}, "spec.resumeFrom names a job of a cluster"),
        ([], {"stack": {"image": "i", "engine": "exec", "command": ["no-such"]}}, "starts no-such"),
        ([], {"matrix": {"variables": {"a": []}}}, "a has no value"),
        ([], {"playback": {"rate": 0}}, "spec.playback.rate"),
        ([], {"source": {}}, "write one of source.bags, source.sequence"),
    ],
)
def test_what_can_t_run_is_refused_with_2_and_nothing_is_made(
    tmp_path: Path, arguments: list[str], changed: dict[str, object], sentence: str
) -> None:
    status, text = run(tmp_path, *arguments, **changed)
    assert (status, sentence in text) == (2, True), text
    assert not (tmp_path / "kept").exists()
    assert "Traceback" not in text


def test_without_java_it_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JAVA_HOME", "/nowhere")
    status, text = run(tmp_path, "--spark")
    assert (status, "Spark needs Java 17 or newer" in text) == (2, True)


def test_without_pyspark_it_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyspark", None)
    status, text = run(tmp_path, "--spark")
    assert (status, "PySpark is not installed: leave --spark out, or" in text) == (2, True), text


def test_neither_java_nor_pyspark_is_asked_for_without_spark(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("JAVA_HOME", "/nowhere")
    monkeypatch.setitem(sys.modules, "pyspark", None)
    _, text = run(tmp_path)
    assert "Java" not in text
    assert "PySpark" not in text


def test_an_agent_that_does_not_start_is_reported_with_its_output(tmp_path: Path) -> None:
    agent = tmp_path / "agent"
    agent.write_text("#!/bin/sh\necho no agent of ours; exit 3\n")
    agent.chmod(0o755)
    status, text = run(tmp_path, "--agent", str(agent))
    assert status == 2, text
    assert "the agent did not start; it wrote: no agent of ours" in text


def wanted(**changed: Any) -> module.Wanted:
    fields: dict[str, Any] = {
        "volumes": (), "results": None, "slots": None, "cases": (), "variants": (), "agent": "a",
        "resume": False, "replace": False, "spark": False, "output": "table",
    }  # fmt: skip
    return module.Wanted(**fields | changed)


def test_an_earlier_run_is_never_overwritten_unasked(tmp_path: Path) -> None:
    folder = publish(tmp_path, [make_row("a-0")])
    (folder / "notes.txt").write_text("mine")
    (folder / "cases").mkdir()
    (folder / "cases/a-0.1.bag").touch()
    with pytest.raises(RunError, match="has a run already: write --replace"):
        module._prepare(folder, wanted())
    module._prepare(folder, wanted(resume=True))
    assert (folder / "manifest.json").exists()
    module._prepare(folder, wanted(replace=True))
    # Of what lies there only what a run makes is removed.
    assert [path.name for path in folder.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("options", [{}, {"replace": True}, {"resume": True}])
@pytest.mark.parametrize(
    "name", ["cases/night/mine.bag", "job.json", "manifest.json", "journal/mine.txt"]
)
def test_what_no_run_has_left_is_neither_removed_nor_written_over(
    tmp_path: Path, name: str, options: dict[str, bool]
) -> None:
    mine = tmp_path / name
    mine.parent.mkdir(parents=True, exist_ok=True)
    mine.write_text('{"name": "mine"}')
    # One log alone may be of anything.
    (tmp_path / "agent.log").write_text("mine too")
    with pytest.raises(RunError, match=f"has {Path(name).parts[0]}, which no run has left"):
        module._prepare(tmp_path, wanted(**options))
    assert mine.read_text() == '{"name": "mine"}'


def test_a_run_that_died_before_its_first_journal_is_replaced(tmp_path: Path) -> None:
    for name in ("agent.log", "driver.log", "cases/a-0.1.bag"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    module._prepare(tmp_path, wanted())
    assert (tmp_path / "cases/a-0.1.bag").exists()
    module._prepare(tmp_path, wanted(replace=True))
    assert list(tmp_path.iterdir()) == []


def test_there_need_be_no_run_to_replace(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    module._prepare(tmp_path, wanted(replace=True))
    module._prepare(tmp_path / "new", wanted(replace=True))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "notes.txt"]


def test_an_interrupted_run_is_resumed_or_replaced(tmp_path: Path) -> None:
    (tmp_path / "driver.log").touch()
    (tmp_path / "journal").mkdir()
    module._prepare(tmp_path, wanted())
    (tmp_path / "journal/0001-x-000000.jsonl").touch()
    with pytest.raises(RunError, match="has an interrupted run: --resume goes on with it"):
        module._prepare(tmp_path, wanted())
    module._prepare(tmp_path, wanted(resume=True))
    assert (tmp_path / "journal/0001-x-000000.jsonl").exists()
    module._prepare(tmp_path, wanted(replace=True))
    assert not (tmp_path / "journal").exists()


def test_a_folder_that_can_t_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RunError, match=r"file/kept can't be written: Not a directory"):
        module._prepare(tmp_path / "file/kept", wanted())


def test_slots_are_the_job_s_own_at_most_one_for_each_processor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _pid: set(range(6)))
    assert module._slots(make_spec(spark={"executors": 2, "slots": 2})) == 4
    assert module._slots(make_spec(spark={"executors": 100, "slots": 4})) == 6
    assert module._slots(make_spec(spark={"executors": {"min": 1, "max": 2}, "slots": 2})) == 4
    assert module._slots(make_spec()) == 1


def test_the_agent_is_found_on_path_or_else_beside_the_python_that_runs_this(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("path", "venv"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "bagpipe-agent").write_text("#!/bin/sh\n")
        (tmp_path / name / "bagpipe-agent").chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "venv" / "python"))
    monkeypatch.setenv("PATH", str(tmp_path / "path"))
    assert agent_program("bagpipe-agent") == str(tmp_path / "path" / "bagpipe-agent")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert agent_program("bagpipe-agent") == str(tmp_path / "venv" / "bagpipe-agent")
    assert agent_program("no-such-agent") is None
