"""`bagpipe run` before anything runs: refusals, and the folder of the results."""

import sys
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from bagpipe.cli import run as module
from bagpipe.cli.__main__ import main
from bagpipe.run import laptop
from bagpipe.run.laptop import agent_program
from tests.unit.bagpipe.jobs import make_spec

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


def test_an_agent_that_is_slow_to_answer_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its first answers take longer than is waited for each, as on a machine that is busy."""
    asked = tmp_path / "asked"
    agent = tmp_path / "agent"
    agent.write_text(
        "#!/bin/sh\n"
        'if [ "$1" = serve ]; then exec sleep 1000; fi\n'
        f'echo >> "{asked}"; if [ "$(wc -l < "{asked}")" -lt 3 ]; then exec sleep 1000; fi\n'
    )
    agent.chmod(0o755)
    monkeypatch.setattr(laptop, "_ANSWER_SECONDS", 1.0)
    with laptop.serving_agent(str(agent), tmp_path, tmp_path / "log"):
        assert asked.read_text().count("\n") >= 3


def test_an_agent_that_never_answers_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    agent = tmp_path / "agent"
    agent.write_text("#!/bin/sh\nexec sleep 1000\n")
    agent.chmod(0o755)
    monkeypatch.setattr(laptop, "_ANSWER_SECONDS", 0.5)
    monkeypatch.setattr(laptop, "_READY_SECONDS", 1.0)
    status, text = run(tmp_path, "--agent", str(agent))
    assert status == 2, text
    assert "the agent did not start; it wrote: nothing" in text


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
