"""The exec engine on the worker's side: files in, files out, and the program's own verdict."""

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bagpipe.case_reasons import REASONS
from bagpipe.driver.journal import Journal
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import Results, results_uri
from bagpipe.driver.row_file import RowFile
from bagpipe.engine.chosen import engine_of
from bagpipe.engine.engine import Played
from bagpipe.engine.exec.judge import judge_program
from bagpipe.engine.exec.outputs import Outputs
from bagpipe.judgement import Judgement
from bagpipe.plan.case import Case
from bagpipe.plan.fragments import Window
from bagpipe.row_facts import recorded_names
from bagpipe.run import case_run
from bagpipe.run.case_run import Row, RunContext, _judged, case_map, run_case
from bagpipe.run.laptop import write_fragment
from bagpipe.source.chosen import source_of
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from bagpipe.wire.frames import FrameType
from bagpipe.wire.session import InputFile, SessionError
from tests.unit.bagpipe.fake_agent import STACK, FakeAgent, Script, aborting, make_slot
from tests.unit.bagpipe.jobs import make_job, make_spec

EXEC: dict[str, Any] = {
    "source": {"files": ["pvc://recordings/*.json"]},
    "stack": {"image": "traffic:1", "command": ["simulate"], "engine": "exec"},
    "record": None,
}
RESULT: dict[str, Any] = {
    "engine": "exec",
    "stack": STACK | {"exit_status": 0, "signal": None, "ended_by": "itself"},
    "files": [],
    "bytes_in": 2,
    "bytes_out": 9,
    "records_in": 1,
    "records_out": 2,
    "program": None,
    "timings": {"stack": 0.1, "run": 0.2, "stop": 0.0},
}
Run = Callable[..., tuple[Row, FakeAgent]]


@pytest.fixture
def context(tmp_path: Path) -> RunContext:
    folders = {name: str(tmp_path / name) for name in ("recordings", "results")}
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings/cut-in.json").write_text("{}")
    spec = make_spec(**EXEC)
    return RunContext("lab/drive", spec, folders, "pvc://results/r", str(tmp_path / "s"))


@pytest.fixture
def run(context: RunContext) -> Run:
    def with_scripts(*scripts: Script) -> tuple[Row, FakeAgent]:
        (case,) = plan(context.spec, Storage(context.volumes)).cases
        with FakeAgent(make_slot(Path(context.shared)), *scripts) as agent:
            return run_case(case, context), agent

    return with_scripts


def giving(files: dict[str, bytes], last: bool = True, **changed: Any) -> Script:
    """An agent whose program gives these files back; `changed` replaces fields of RESULT."""

    def script(agent: FakeAgent) -> None:
        agent.read_until(FrameType.END)
        outgoing = agent.open_outgoing()
        agent.greet(outgoing)
        for name, data in files.items():
            agent.send(outgoing, FrameType.FILE, {"name": name, "size": len(data)})
            if data:
                agent.write(outgoing, FrameType.DATA, data)
        if not last:
            abort = {"reason": "StackCrashed", "message": "it crashed", "exit_status": 3}
            agent.send(outgoing, FrameType.ABORT, abort)
            return
        agent.send(outgoing, FrameType.RESULT, RESULT | changed)
        total = sum(len(data) for data in files.values())
        end = {"files": len(files), "bytes": total, "digest": agent._encoder.digest}
        agent.send(outgoing, FrameType.END, end)

    return script


def kept(context: RunContext) -> dict[str, bytes]:
    folder = Path(context.volumes["results"]) / "r/cases"
    return {path.name: path.read_bytes() for path in folder.glob("*")}


def test_every_file_of_the_program_is_kept_under_its_name(run: Run, context: RunContext) -> None:
    row, agent = run(giving({"tracks.csv": b"t,x,y", "empty": b"", "log.txt": b"text"}))
    assert (row["outcome"], row["attempts"], row["case"]) == ("passed", 1, "cut-in")
    assert {name.split(".", 2)[2]: data for name, data in kept(context).items()} == {
        "tracks.csv": b"t,x,y", "empty": b"", "log.txt": b"text",
    }  # fmt: skip
    assert sorted(row["recorded"]) == sorted(f"cases/{name}" for name in kept(context))
    json.dumps(row)
    case = agent.received[0].fields()["case"]
    assert (case["engine"], case["stack"]["command"]) == ("exec", ["simulate"])
    assert case["source"] == "pvc://recordings/cut-in.json"
    assert case["window"] == {"lead_in_start": 0, "start": 0, "end": 0}


def test_the_program_gets_the_file_as_it_is(run: Run, context: RunContext) -> None:
    data = bytes(range(256)) * 10_000
    (Path(context.volumes["recordings"]) / "cut-in.json").write_bytes(data)
    row, agent = run(giving({"a": b"1"}))
    assert row["outcome"] == "passed"
    sent = [frame.payload for frame in agent.received if frame.type is FrameType.DATA]
    assert b"".join(sent) == data
    assert max(map(len, sent)) == 1 << 20
    described = next(f for f in agent.received if f.type is FrameType.FILE).fields()
    assert described == {
        "name": "cut-in.json",
        "size": len(data),
        "ranges": [[0, 0, len(data)]],
    }


def test_a_file_of_unknown_size_has_the_bytes_that_came(run: Run, context: RunContext) -> None:
    def script(agent: FakeAgent) -> None:
        agent.read_until(FrameType.END)
        outgoing = agent.open_outgoing()
        agent.greet(outgoing)
        for name in ("a", "b"):
            agent.send(outgoing, FrameType.FILE, {"name": name, "size": None})
            agent.write(outgoing, FrameType.DATA, name.encode())
            agent.write(outgoing, FrameType.DATA, b"!")
        agent.send(outgoing, FrameType.RESULT, RESULT)
        end = {"files": 2, "bytes": 4, "digest": agent._encoder.digest}
        agent.send(outgoing, FrameType.END, end)

    row, _ = run(script)
    assert row["outcome"] == "passed"
    assert sorted(kept(context).values()) == [b"a!", b"b!"]


def test_nothing_stays_of_an_attempt_that_breaks_off(run: Run, context: RunContext) -> None:
    row, _ = run(giving({"whole": b"data", "cut": b"more"}, last=False))
    assert (row["outcome"], row["reason"], row["attempts"]) == ("failed", "StackCrashed", 1)
    assert (row["recorded"], kept(context)) == (None, {})


@pytest.mark.parametrize("name", ["../../x", "/etc/x", "..", "", "a\\b", "a\nb", "x" * 256])
def test_a_name_that_leaves_the_folder_is_refused(
    name: str, run: Run, context: RunContext, tmp_path: Path
) -> None:
    row, _ = run(giving({name: b"x"}))
    assert (row["outcome"], row["reason"], row["attempts"]) == ("errored", "StackProtocolError", 1)
    assert "write a plain name" in row["message"]
    files = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert (kept(context), files) == ({}, {"cut-in.json", "lease"})


def test_two_files_of_one_name_and_a_short_file_are_refused(tmp_path: Path) -> None:
    outputs = Outputs(Storage({"results": str(tmp_path)}), "pvc://results/r", "cases/a.1")
    outputs.begin("x", 0)
    with pytest.raises(SessionError, match="came twice"):
        outputs.begin("x", 0)
    outputs.begin("y", 2).write(b"1")
    with pytest.raises(SessionError, match=r"cases/a\.1\.y has not the size"):
        outputs.finish()
    outputs.discard(ValueError())
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_program_that_gives_up_is_an_error_with_its_words(run: Run) -> None:
    row, _ = run(aborting("StackAborted", "the program gave up: no licence", ["no licence"]))
    assert (row["outcome"], row["reason"], row["attempts"]) == ("errored", "StackAborted", 1)
    assert row["stderr"] == ["no licence"]


@pytest.mark.parametrize(
    ("program", "outcome", "reason", "message"),
    [
        (None, "passed", "", ""),
        ({}, "invalid", "UnknownOutcome", "has nothing and no outcome"),
        ({"outcom": "failed"}, "invalid", "UnknownOutcome", "has outcom and no outcome"),
        ({"figures": {"gap": 3.5}}, "invalid", "UnknownOutcome", "has figures and no outcome"),
        ({"outcome": "passed", "message": "clear"}, "passed", "", "clear"),
        ({"outcome": "failed", "message": "crashed"}, "failed", "ProgramFailed", "crashed"),
        ({"outcome": "failed", "reason": "Collision"}, "failed", "Collision", "says failed"),
        ({"outcome": "failed", "reason": "no word"}, "failed", "ProgramFailed", "says failed"),
        ({"outcome": "invalid", "message": "no car"}, "invalid", "ProgramInvalid", "no car"),
        ({"outcome": "fine"}, "invalid", "UnknownOutcome", "write passed, failed or invalid"),
        ({"outcome": ["passed"]}, "invalid", "UnknownOutcome", "write passed, failed or invalid"),
    ],
)
def test_the_programs_own_word_is_the_verdict(
    program: dict[str, Any] | None, outcome: str, reason: str, message: str
) -> None:
    judgement = judge_program(RESULT | {"program": program})
    assert (judgement.outcome, judgement.reason) == (outcome, reason)
    assert message in judgement.message


@pytest.mark.parametrize("outcome", ["failed", "invalid"])
@pytest.mark.parametrize("reason", sorted(REASONS))
def test_bagpipe_s_own_words_are_no_program_s(
    run: Run, monkeypatch: pytest.MonkeyPatch, reason: str, outcome: str
) -> None:
    """By `ProtocolError`, honest in a test of a protocol, its failure bought it more tries."""
    monkeypatch.setattr(case_run, "_MEETING_SECONDS", 1.0)  # no agent is there for another try
    verdict = {"outcome": outcome, "reason": reason, "message": "it collided"}
    row, _ = run(giving({}, program=verdict))
    assert (row["outcome"], row["attempts"], row["discarded"]) == (outcome, 1, [])
    assert row["reason"] == ("ProgramFailed" if outcome == "failed" else "ProgramInvalid")
    assert row["message"] == f"{reason}: it collided"


@pytest.mark.parametrize("reason", ["ProtocolError", "MachineBusy", "StorageFull"])
@pytest.mark.parametrize(("outcome", "attempts"), [("failed", 1), ("invalid", 1), ("errored", 2)])
def test_a_verdict_is_tried_again_for_no_word_of_the_machinery(
    run: Run, monkeypatch: pytest.MonkeyPatch, reason: str, outcome: str, attempts: int
) -> None:
    """The second wall, behind that of the engine."""
    monkeypatch.setattr(case_run, "_pause", lambda _again: None)
    found = [{"outcome": outcome, "reason": reason, "message": "", "recorded": None}]

    def judged(played: Played) -> Row:
        return _judged(played) | (found.pop() if found else {})

    monkeypatch.setattr(case_run, "_judged", judged)
    row, _ = run(*[giving({}, program={"outcome": "passed"})] * attempts)
    assert (row["outcome"], row["attempts"]) == (outcome if attempts == 1 else "passed", attempts)


def test_a_program_s_message_is_bounded() -> None:
    def judged(**program: Any) -> Judgement:
        return judge_program(RESULT | {"program": program})

    long = judged(outcome="failed", reason="R" * 64, message="x" * 2001)
    assert (long.reason, long.message) == ("R" * 64, "x" * 2000)
    assert judged(outcome="failed", reason="R" * 65).reason == "ProgramFailed"
    assert judged(outcome="failed", reason=["R"]).reason == "ProgramFailed"
    unknown = judged(outcome="x" * 101).message
    assert unknown.startswith(f"the program's outcome is '{'x' * 100}': write passed")
    misspelt = judged(**{"x" * 101: 1}).message
    assert misspelt.startswith(f"the program's RESULT has {'x' * 100} and no outcome")


def test_nothing_at_all_is_no_evidence() -> None:
    judgement = judge_program(RESULT | {"records_out": 0})
    assert (judgement.outcome, judgement.reason) == ("invalid", "NothingRecorded")
    for nothing in ({"records_out": 1, "bytes_out": 0}, {"records_out": 0, "program": {}}):
        judgement = judge_program(RESULT | nothing)
        assert (judgement.outcome, judgement.reason) == ("invalid", "NothingRecorded")
    # A word without a file is evidence.
    spoken = RESULT | {"records_out": 0, "program": {"outcome": "passed"}}
    assert judge_program(spoken).outcome == "passed"


@pytest.mark.parametrize(
    ("changed", "reason", "words"),
    [
        ({"program": {"gap": math.nan}}, "StackProtocolError", "is not JSON"),
        ({"program": {"image": b"png"}}, "StackProtocolError", "is not JSON"),
        ({"stack": {"exit_status": 3}}, "StackCrashed", "exit status is 3"),
        ({"stack": {"exit_status": -9}}, "StackCrashed", "exit status is -9"),
    ],
)
def test_an_answer_of_no_use_is_an_error(changed: dict[str, Any], reason: str, words: str) -> None:
    with pytest.raises(SessionError, match=words) as refused:
        judge_program(RESULT | changed)
    assert refused.value.reason == reason


def test_a_result_of_another_engine_keeps_nothing(run: Run, context: RunContext) -> None:
    row, _ = run(*[giving({"a": b"1"}, engine="ros1")] * 3)  # it is worth another try
    assert (row["outcome"], row["reason"]) == ("errored", "ProtocolError")
    assert "RESULT from the agent has 'ros1' as engine" in row["message"]
    assert kept(context) == {}


def test_one_case_for_each_file_and_a_sentence_for_what_is_missing(tmp_path: Path) -> None:
    for name in ("a.json", "b c.json", "sub/a.json", "big.bin"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"x" * (7 if name == "big.bin" else 1))
    storage = Storage({"recordings": str(tmp_path)})

    def cases(*files: str) -> list[Case]:
        source = {"files": [f"pvc://recordings/{name}" for name in files]}
        made = plan(make_spec(**EXEC | {"source": source}), storage)
        assert [(u.reason, u.bag) for u in made.unplanned] == [
            ("FileMissing", "pvc://recordings/none.json")
        ] * ("none.json" in files)
        return made.cases

    made = cases("*.json", "big.bin", "none.json")
    assert [(case.id, case.bytes) for case in made] == [("big", 7), ("a", 1), ("b-c", 1)]
    names = {case.bag: case.id for case in cases("a.json", "sub/a.json")}
    assert len(set(names.values())) == 2
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "a.json").write_bytes(b"x")
    more = {case.bag: case.id for case in cases("a.json", "more/a.json", "sub/a.json")}
    assert names.items() < more.items()
    (tmp_path / "a.yaml").touch()
    assert [case.id for case in cases("a.json", "a.yaml")] == ["a.json", "a.yaml"]


def test_bags_go_to_a_program_as_fragments(context: RunContext) -> None:
    spec = make_spec(**EXEC | {"source": {"bags": ["pvc://recordings/*.bag"]}})
    assert spec.source.kind == "bags"
    case = Case("a-0000", "pvc://recordings/a.bag", "1-1", Window(1, 2, 3), [], [(0, 1)], 1)
    described = case_map(case, dataclasses.replace(context, spec=spec))
    file = engine_of("exec").input(source_of(spec), case, Storage(context.volumes))
    assert isinstance(file, InputFile)
    assert (file.name, file.ranges[0][1:]) == ("a.bag", (0, 1))
    assert described["record"] == {"topics": [], "byte_budget": 1 << 30}


def test_a_file_that_is_replayed_is_the_file(context: RunContext, tmp_path: Path) -> None:
    spec = make_spec(**EXEC)
    storage = Storage(context.volumes)
    case = plan(spec, storage).cases[0]
    written = write_fragment(case, source_of(spec), storage, tmp_path / "again")
    uri = case.bag.removeprefix("pvc://recordings/")
    original = Path(context.volumes["recordings"], uri)
    assert written.read_bytes() == original.read_bytes()
    assert (written.stem, written.suffix) == ("again", original.suffix)


def test_all_outputs_that_count_are_kept_and_no_ledger_is_needed(tmp_path: Path) -> None:
    job = make_job({"results": str(tmp_path)}, **EXEC)
    storage = Storage(job.volumes)
    names = ["cases/a.1.x", "cases/a.1.y", "cases/a.2.x"]
    for name in names:
        with storage.create(f"{results_uri(job)}/{name}") as file:
            file.write(b"data")
    row = {
        "case": "a", "outcome": "passed", "reason": "", "message": "", "attempts": 1,
        "recorded": names[:2], "result": RESULT,
    }  # fmt: skip
    progress = Progress(results_uri(job))
    progress.begin(1)
    progress.add(row)
    journal = Journal(storage, results_uri(job), 1)
    with RowFile(tmp_path / "rows") as rows:
        rows.add(row)
        results = Results(job, storage)
        results.publish(results.commit(rows, progress, journal.driver), rows.rows, journal)
    assert recorded_names(row) == names[:2]
    assert storage.names(f"{results_uri(job)}/cases") == ["a.1.x", "a.1.y"]
    manifest = json.loads((tmp_path / "out/drive/uid-1/manifest.json").read_text())
    assert manifest["cases"][0]["recorded"] == names[:2]
    assert manifest["ledger"] == {"sent": 0, "received": 0, "dropped": 0, "leadIn": 0}
