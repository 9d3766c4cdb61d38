"""`bagpipe run` as people start it: a program, with a real agent and real ROS nodes; without Java,
and with a real Spark.
"""

import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.integration.conftest import ROOT
from tests.integration.laptop import STEP_SECONDS, Laptop
from tests.integration.stacks import EXAMPLE, folders_with_recording
from tests.recording import MESSAGES
from tests.waiting import patient

pytestmark = pytest.mark.integration

BARRIER_CAR = ROOT / "docs/examples/barrier-car"
# Each case waits until a file of its own name is in the folder.
WAITS = """
import pathlib, time
from bagpipe import binpipe
folder = pathlib.Path(FOLDER)
for record in binpipe.read():
    record.read()
    while not (folder / record.name).exists():
        time.sleep(0.1)
    binpipe.write(b"done", name="answer")
"""


@pytest.fixture
def laptop(tmp_path: Path, agent_binary: Path) -> Iterator[Laptop]:
    made = Laptop(tmp_path, agent_binary)
    yield made
    made.await_nothing_left()


def with_recording(laptop: Laptop) -> None:
    folders_with_recording(laptop.folder)


def example(**changed: Any) -> dict[str, Any]:
    """The example's spec, four fragments in lock-step, with fields replaced."""
    return patient(yaml.safe_load(EXAMPLE.read_text())["spec"]) | changed


def rows_of(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "results.jsonl").read_text().splitlines()]


def test_a_real_job_passes_and_leaves_what_a_cluster_leaves(laptop: Laptop) -> None:
    with_recording(laptop)
    manifest = laptop.manifest("pr2", example())
    status, output, errors = laptop.job(manifest, "--slots", "2", "--output", "json")
    assert status == 0, errors
    result = json.loads(output)
    assert (result["phase"], result["verdict"]) == ("Complete", "Passed")
    assert result["counts"] | {"discarded": 0} == {
        "planned": 4, "running": 0, "passed": 4, "failed": 0, "invalid": 0, "errored": 0,
        "crashed": 0, "lost": 0, "regressed": 0, "quarantined": 0,
        "discarded": 0,
    }  # fmt: skip
    ledger = result["ledger"]
    assert (ledger["sent"], ledger["received"], ledger["dropped"]) == (MESSAGES, MESSAGES, 0)
    folder = laptop.folder / "bagpipe-results/pr2"
    assert result["results"] == str(folder)
    assert {path.name for path in folder.iterdir()} == {
        "manifest.json", "results.jsonl", "results.parquet", "junit.xml", "report.html",
        "job.json", "recordings.json.gz", "run.json", "cases", "journal", "agent.log", "driver.log",
    }  # fmt: skip
    rows = rows_of(folder)
    assert [row["case"] for row in rows] == [f"joint_states-{n:04d}" for n in range(4)]
    for row in rows:
        assert (folder / row["recorded"]).stat().st_size > 10_000
    assert len(list((folder / "cases").iterdir())) == 4
    assert list((folder / "journal").iterdir()) == []
    lines = errors.splitlines()
    assert "starting 2 slots" in lines
    assert lines[-1] == "bagpipe-results/pr2 has report.html, results.jsonl and more"
    assert any(line.startswith("4 of 4 cases (4 passed)") for line in lines), errors
    assert any("images are not used here" in line for line in lines)

    status, output, _ = laptop.run("results", folder)
    assert (status, output.split("\n")[0]) == (0, "Passed  pr2")
    status, output, _ = laptop.run("report", folder, "--to", laptop.folder / "page.html")
    assert (status, "page.html" in output) == (0, True)
    status, _, errors = laptop.job(manifest)
    assert (status, "has a run already: write --replace" in errors) == (2, True)


def test_spark_and_processes_record_the_same_bytes(laptop: Laptop) -> None:
    with_recording(laptop)
    manifest = laptop.manifest("pr2", example())
    recorded = []
    for words in (["--results", "here"], ["--results", "spark", "--spark"]):
        status, _, errors = laptop.job(manifest, "--cases", "2", "--slots", "2", *words)
        assert status == 0, errors
        folder = laptop.folder / words[1]
        recorded.append([(folder / row["recorded"]).read_bytes() for row in rows_of(folder)])
    assert "starting Spark and 2 slots" in errors.splitlines()
    assert len(recorded[0]) == 2
    assert recorded[0] == recorded[1]


def test_a_failing_criterion_ends_with_1_and_variants_are_compared(laptop: Laptop) -> None:
    with_recording(laptop)
    criteria = [
        {"name": "some", "presence": {"topic": "/tf", "min": 1}},
        {"name": "many", "presence": {"topic": "/tf", "min": 2}},
    ]
    # At most one answer a second, of the two that there are to the fragment's messages otherwise.
    slow = {"/robot_state_publisher/publish_frequency": 1.0}
    variants = [{"name": "usual"}, {"name": "slow", "parameters": slow}]
    spec = example(variants=variants, evaluate=criteria)
    # Who gives no answer has the next input at the deadline, by when it has taken this one: its
    # queue has room for one. It is long for a slow machine, and so one message alone goes without.
    spec["playback"]["steps"][0] |= {"deadline": "20s", "optional": True}
    spec["source"]["fragment"] = {"length": "45ms"}
    status, output, errors = laptop.job(
        laptop.manifest("two", spec), "--cases", "*-0000-*", "--results", "my kept", "--slots", "2"
    )
    assert status == 1, errors
    headline = output.splitlines()[0]
    assert headline.startswith("Failed: 1 failed"), headline
    assert headline.endswith("  two"), headline
    folder = laptop.folder / "my kept"
    outcomes = {row["case"]: row["outcome"] for row in rows_of(folder)}
    assert outcomes == {"joint_states-0000-usual": "passed", "joint_states-0000-slow": "failed"}
    comparison = json.loads((folder / "comparison.json").read_text())["comparisons"][0]
    assert comparison["regressed"] == [
        {"case": "joint_states-0000-slow", "to": "failed", "reason": "CriterionFailed"}
    ]
    status, output, _ = laptop.run("results", folder, "--failed", "--output", "yaml")
    assert (status, [row["variant"] for row in yaml.safe_load(output)["cases"]]) == (1, ["slow"])


def test_what_can_t_be_run_ends_with_2_and_says_why(laptop: Laptop) -> None:
    with_recording(laptop)
    spec = example()
    spec["source"]["bags"] = ["pvc://recordings/nowhere/*.bag"]
    status, output, errors = laptop.job(laptop.manifest("missing", spec))
    assert (status, output.splitlines()[0]) == (2, "No verdict: 1 errored  missing"), errors
    assert "1 of 1 cases errored" in output
    assert "1 of 1 cases (1 errored)" in errors
    spec = example()
    spec["stack"]["command"] = ["no_such_publisher"]
    status, _, errors = laptop.job(laptop.manifest("command", spec))
    assert (status, "stack.command starts no_such_publisher" in errors) == (2, True)
    status, _, errors = laptop.job(laptop.manifest("chosen", example()), "--cases", "night-*")
    assert status == 2
    assert "NoCaseChosen: none of the 4 cases is called night-*; the first is joint_sta" in errors
    bad = laptop.folder / "bad.yaml"
    bad.write_text("kind: SimulationJob\n")
    status, _, errors = laptop.job(bad)
    assert (status, "apiVersion is ''" in errors) == (2, True)


def test_a_simulated_job_runs_as_many_cases_as_are_asked_for(laptop: Laptop) -> None:
    spec = patient(yaml.safe_load((BARRIER_CAR / "job.yaml").read_text())["spec"])
    spec["stack"]["command"] = ["/usr/bin/python3", str(BARRIER_CAR / "planner.py")]
    manifest = laptop.manifest("barrier", spec)
    status, output, errors = laptop.run(
        "run", manifest, "--agent", laptop.agent, "--cases", "2", "--output", "json"
    )
    assert status == 0, errors
    result = json.loads(output)
    assert (result["counts"]["planned"], result["counts"]["passed"]) == (2, 2)
    assert all(case["criteria"][0]["name"] == "steers" for case in result["cases"])


def waiting(laptop: Laptop, cases: int) -> Path:
    """A job of the exec engine whose cases 0, 1, ... wait for the files `0.bin`, `1.bin`, ..."""
    (laptop.folder / "recordings").mkdir()
    for number in range(cases):
        (laptop.folder / f"recordings/{number}.bin").write_text(str(number))
    program = WAITS.replace("FOLDER", repr(str(laptop.folder)))
    spec = {
        "source": {"files": ["pvc://recordings/*.bin"]},
        "stack": {"engine": "exec", "image": "any", "command": [sys.executable, "-c", program]},
        "spark": {"slots": 2},
        "output": {"uri": "pvc://results/r"},
    }
    return laptop.manifest("waits", spec)


def let_go(laptop: Laptop, *cases: int) -> None:
    for number in cases:
        (laptop.folder / f"{number}.bin").touch()


def await_line(process: "subprocess.Popen[str]", wanted: str) -> None:
    """Read its stderr until a line holds `wanted`; the rest stays for `communicate`."""
    assert process.stderr is not None
    for line in process.stderr:
        if wanted in line:
            return
    raise AssertionError(f"it ended without saying {wanted!r}")


def started_cases(laptop: Laptop) -> int:
    return sum("binpipe.read()" in line for line in laptop.left_over())


def await_cases(laptop: Laptop, count: int, process: "subprocess.Popen[str]") -> None:
    deadline, pause = time.monotonic() + STEP_SECONDS, threading.Event()
    while started_cases(laptop) < count:
        assert process.poll() is None
        assert time.monotonic() < deadline, laptop.left_over()
        pause.wait(0.1)


@pytest.mark.parametrize(
    ("number", "engine"),
    [(signal.SIGINT, []), (signal.SIGTERM, []), (signal.SIGTERM, ["--spark"])],
)
def test_an_interruption_ends_all_that_was_started_and_is_gone_on_with(
    laptop: Laptop, number: signal.Signals, engine: list[str]
) -> None:
    manifest = waiting(laptop, 3)
    process = laptop.start(*laptop.words(manifest), "--slots", "2", *engine)
    await_cases(laptop, 2, process)
    process.send_signal(number)
    output, errors = process.communicate(timeout=STEP_SECONDS)
    assert (process.returncode, output) == (2, ""), errors
    assert "interrupted after 0 of 3 cases; --resume goes on with the other cases" in errors
    laptop.await_nothing_left()
    let_go(laptop, 0, 1, 2)
    status, output, errors = laptop.job(manifest, "--resume", "--output", "json")
    assert status == 0, errors
    assert json.loads(output)["counts"]["passed"] == 3


def test_what_was_done_before_an_interruption_is_not_done_again(laptop: Laptop) -> None:
    manifest = waiting(laptop, 3)
    let_go(laptop, 0)
    process = laptop.start(*laptop.words(manifest), "--slots", "1")
    await_line(process, "1 of 3 cases (1 passed)")
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=STEP_SECONDS)
    assert (process.returncode, "interrupted after 1 of 3 cases" in errors) == (2, True), errors
    folder = laptop.folder / "bagpipe-results/waits"
    (segment,) = (folder / "journal").iterdir()
    journaled = json.loads(segment.read_text())
    assert journaled["case"] == "0"
    status, _, errors = laptop.job(manifest)
    assert (status, "has an interrupted run: --resume goes on with it" in errors) == (2, True)
    # Were it run again, it would wait for ever.
    (laptop.folder / "0.bin").unlink()
    let_go(laptop, 1, 2)
    status, _, errors = laptop.job(manifest, "--resume")
    assert status == 0, errors
    first, *others = rows_of(folder)
    assert first["result"] == journaled["result"]
    assert [row["case"] for row in others] == ["1", "2"]


@pytest.mark.parametrize("engine", [[], ["--spark"]])
def test_a_run_that_is_killed_takes_its_processes_with_it(
    laptop: Laptop, engine: list[str]
) -> None:
    process = laptop.start(*laptop.words(waiting(laptop, 1)), *engine)
    await_cases(laptop, 1, process)
    process.kill()
    process.communicate(timeout=STEP_SECONDS)
    laptop.await_nothing_left()
