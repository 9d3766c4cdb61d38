"""A source is one folder: tests/toy_source on Python's path, of which nothing else knows."""

import base64
import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from bagpipe import MemoryBag
from tests.unit.bagpipe.test_added_engine import (
    COUNTED,
    DERIVED,
    OPERATOR,
    REFUSED,
    ROOT,
    TOY,
    python,
)

TICKS = ROOT / "tests/toy_source"
SPEC: dict[str, Any] = {
    "source": {"ticks": {"count": 30}},
    "stack": {"image": "any", "command": ["cat"]},
    "record": {"topics": ["/ticks"]},
    "output": {"uri": "pvc://results/r"},
}
# What pydantic says of each fault: where, and the sentence.
FAULTS = REFUSED.replace('print(error.errors()[0]["msg"])', "print(error.json())")
# Both ways: with the source, and from there back without it.
AGAIN = """
import json, sys
sys.path.insert(0, "crds")
import generate
from bagpipe.source_fields import source_fields, source_names
every = {name: source_fields(name) for name in source_names()}
text = generate.JOBS.read_text()
added = generate.with_sources(text, every)
less = {name: fields for name, fields in every.items() if name != "ticks"}
try:
    generate.with_sources(text, {**less, "other": source_fields("bags")})
except SystemExit as error:
    lacking = str(error)
again = generate.with_sources(added, every)
less = generate.with_sources(added, less)
print(json.dumps([again == added, added != text, less == text, lacking]))
"""
# A worker with a stand-in for the agent, in another process than the one that read the spec.
SENT = """
import base64, json, pickle, sys
from pathlib import Path
from bagpipe.run.case_run import RunContext, run_case
from bagpipe.run.laptop import planned_case
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from bagpipe.wire.frames import FrameType
from tests.unit.bagpipe.fake_agent import FakeAgent, make_slot
spec, shared = pickle.loads(Path(sys.argv[1]).read_bytes()), sys.argv[2]
(case,) = plan(spec, Storage({})).cases
context = RunContext("lab/ticks", spec, {"results": shared}, "pvc://results/r", shared)
sent = []
def echo(agent):
    agent.read_until(FrameType.END)
    sent.append(b"".join(f.payload for f in agent.received if f.type is FrameType.DATA))
    outgoing = agent.open_outgoing()
    agent.greet(outgoing)
    agent.finish(outgoing, sent[0], int(sys.argv[3]))
with FakeAgent(make_slot(Path(shared)), echo) as agent:
    row = run_case(case, context)
hello = agent.received[0].fields()["case"]
again = planned_case(row, spec, Storage({})).id if row["outcome"] == "passed" else ""
print(json.dumps([row, hello, base64.b64encode(sent[0]).decode(), again]))
"""
PICKLED = """
import json, pickle, sys
from pathlib import Path
from bagpipe.spec import SimulationJobSpec
spec = SimulationJobSpec.model_validate(json.loads(sys.argv[1]))
Path(sys.argv[2]).write_bytes(pickle.dumps(spec))
"""
HALF = """
import json, sys
from bagpipe.installed import InstallationError
from bagpipe.source.chosen import source_of
from bagpipe.spec import SimulationJobSpec
try:
    source_of(SimulationJobSpec.model_validate(json.loads(sys.argv[1])))
except InstallationError as error:
    print(error)
"""
GOOD = (TICKS / "bagpipe_sources/ticks/fields.py").read_text()
# Folders of sources that can't be used, their `fields` and the sentence.
BROKEN = {
    "bare": (None, "the source's module bagpipe_sources.bare.fields can't be loaded (ModuleNot"),
    "needy": ("import carla", "the source's module bagpipe_sources.needy.fields can't be loaded"),
    "topics": (GOOD, "the source 'topics' can't be a key of spec.source: rename its folder to one"),
    "uris": (GOOD, "the source 'uris' can't be a key of spec.source: rename its folder to one"),
    "my_ticks": (GOOD, "the source 'my_ticks' can't be a key of spec.source: rename its folder"),
    "odd": (
        GOOD.replace("type=Ticks | None", "type=42"),
        "the type that the source 'odd' declares is none for pydantic (Unable to generate pydantic",
    ),
    "bags": (GOOD, "bagpipe.source.bags and bagpipe_sources.bags are sources of one name: remove"),
}


def faults(changed: dict[str, Any], *, path: tuple[Path, ...] = (TICKS,)) -> list[tuple[str, str]]:
    """The place and the sentence of each refusal."""
    done = python("-c", FAULTS, json.dumps(SPEC | changed), path=path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout or "[]")
    return [(".".join(map(str, e["loc"])), e["msg"].removeprefix("Value error, ")) for e in found]


def manifest(folder: Path) -> str:
    """A job's file."""
    job = {"apiVersion": "sim.bagpipe.io/v1alpha1", "kind": "SimulationJob"}
    file = folder / "job.yaml"
    file.write_text(yaml.safe_dump(job | {"metadata": {"name": "toy"}, "spec": SPEC}))
    return str(file)


def add(folder: Path, name: str, fields: str | None) -> None:
    """A source of this name below a place on Python's path."""
    place = folder / "bagpipe_sources" / name
    place.mkdir(parents=True)
    (place / "__init__.py").touch()
    if fields is not None:
        (place / "fields.py").write_text(fields)


def test_the_crd_gets_its_key_and_the_rule_that_one_is_there() -> None:
    done = python("-c", DERIVED, path=(TICKS,))
    assert done.returncode == 0, done.stderr
    derived = json.loads(done.stdout)
    text = derived[str(ROOT / "crds/simulationjobs.yaml")]
    committed = (ROOT / "crds/simulationjobs.yaml").read_text()
    head, _, rest = text.partition(" " * 18 + "ticks:\n")
    added, end, rest = rest.partition(" " * 18 + "# The end of what is added.\n")
    without = (head + end + rest).replace(", has(self.ticks)].", "].")
    assert (
        without.replace("simulator, catalogue and ticks:", "simulator and catalogue:") == committed
    )
    assert yaml.safe_load(added)["properties"]["count"]["maximum"] == 1000
    schedules = derived[str(ROOT / "charts/bagpipe/files/simulationschedules.yaml")]
    assert (text.count("has(self.ticks)"), schedules.count("has(self.ticks)")) == (1, 1)
    assert "### `spec.source.ticks.every`" in derived[str(ROOT / "docs/reference/simulationjob.md")]


def test_what_is_written_into_the_crd_is_written_once_and_leaves_no_trace() -> None:
    done = python("-c", AGAIN, path=(TICKS,))
    assert done.returncode == 0, done.stderr
    lacking = "source.other has no schema: write one into its FIELDS"
    assert json.loads(done.stdout) == [True, True, True, lacking]


def test_its_spec_is_accepted_and_what_it_declares_is_refused_in_its_place() -> None:
    assert faults({}) == []
    assert faults({"source": {"ticks": {"count": 0}}}) == [
        ("source.ticks.count", "Input should be greater than or equal to 1")
    ]
    assert faults({"source": {"ticks": {"count": 9}, "topics": ["/a"]}}) == [
        (
            "source",
            "source.topics and source.fragment select from bags: leave them out with source.ticks",
        )
    ]
    assert faults({"source": {"ticks": {"count": 9}}, "playback": {"rounds": 10}}) == [
        (
            "",
            "source.ticks are played in at most as many rounds as there are: lower playback.rounds",
        )
    ]


def test_a_job_has_one_source_of_those_that_are_there() -> None:
    (one,) = faults({"source": {}})
    known = "write one of source.bags, source.sequence and source.files, with at least one URI, or "
    assert one == ("source", known + "source.simulator or source.catalogue or source.ticks")
    assert faults({"source": {"ticks": {"count": 9}, "bags": ["pvc://a/b"]}}) == [one]
    assert faults({}, path=()) == [("source", known + "source.simulator or source.catalogue")]


def test_it_is_taken_by_the_engines_that_take_what_it_says(tmp_path: Path) -> None:
    stack = {"image": "any", "command": ["cat"]}
    assert faults({"stack": stack | {"engine": "exec"}, "record": None}) == []
    assert faults({"stack": stack | {"engine": "loopback"}}, path=(TOY, TICKS)) == []
    add(tmp_path, "alone", GOOD.replace('    taken_as="bags",\n', ""))
    assert faults({"source": {"alone": {"count": 9}}}, path=(tmp_path,)) == [
        ("", "no engine that is here takes source.alone: write source.bags")
    ]


@pytest.mark.parametrize("name", BROKEN)
def test_one_that_can_t_be_used_is_a_sentence_of_each_program(tmp_path: Path, name: str) -> None:
    declared, sentence = BROKEN[name]
    add(tmp_path, name, declared)
    plan = python("-m", "bagpipe.cli", "plan", manifest(tmp_path), path=(TICKS, tmp_path))
    assert (plan.returncode, plan.stdout) == (2, "")
    assert plan.stderr.startswith(f"Error: {sentence}")
    operator = python("-c", OPERATOR, path=(TICKS, tmp_path))
    assert operator.returncode == 1
    assert operator.stderr.startswith(f"bagpipe-operator: {sentence}")
    assert [text.count("\n") for text in (plan.stderr, operator.stderr)] == [1, 1]


def test_one_without_its_object_is_a_sentence_where_a_job_needs_it(tmp_path: Path) -> None:
    add(tmp_path, "half", GOOD)
    done = python(
        "-c", HALF, json.dumps(SPEC | {"source": {"half": {"count": 9}}}), path=(tmp_path,)
    )
    assert done.returncode == 0, done.stderr
    start = "the source's module bagpipe_sources.half.source can't be loaded (ModuleNotFoundError"
    assert done.stdout.startswith(start)
    done = python("-c", HALF, json.dumps(SPEC), path=(tmp_path, TICKS))
    assert (done.returncode, done.stdout) == (0, "")


def test_its_cases_are_planned(tmp_path: Path) -> None:
    done = python(
        "-m", "bagpipe.cli", "plan", manifest(tmp_path), "--output", "json", path=(TICKS,)
    )
    assert done.returncode == 0, done.stderr
    (case,) = json.loads(done.stdout)["cases"]
    assert (case["case"], case["bag"], case["messages"]) == ("ticks", "ticks", 30)
    assert case["seconds"] == pytest.approx(2.9)


def ran(folder: Path, least: int, answered: int) -> Any:
    """The row, HELLO's case, the bag that was sent, and the case that is found again."""
    criterion = {"name": "ticks", "presence": {"topic": "/ticks", "min": least}}
    spec, shared = str(folder / "spec"), str(folder / "shared")
    wanted = json.dumps(SPEC | {"evaluate": [criterion]})
    assert python("-c", PICKLED, wanted, spec, path=(TICKS,)).returncode == 0
    done = python("-c", SENT, spec, shared, str(answered), path=(TICKS,))
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_its_case_is_sent_passes_and_is_found_again(tmp_path: Path) -> None:
    row, hello, sent, again = ran(tmp_path, 30, 30)
    assert (row["outcome"], row["attempts"], row["bag"]) == ("passed", 1, "ticks"), row
    assert (hello["source"], hello["engine"]) == ("ticks", "ros1")
    assert again == "ticks"
    messages = list(MemoryBag(base64.b64decode(sent)).messages())
    assert [int.from_bytes(raw, "little") for _, _, raw in messages] == list(range(30))
    assert [time for _, time, _ in messages] == [10**9 + n * 10**8 for n in range(30)]


@pytest.mark.parametrize(
    ("least", "answered", "reason"), [(31, 30, "CriterionFailed"), (30, 29, "TicksMissing")]
)
def test_its_case_fails_by_a_criterion_or_by_its_own_judgement(
    tmp_path: Path, least: int, answered: int, reason: str
) -> None:
    row, *_ = ran(tmp_path, least, answered)
    assert (row["outcome"], row["reason"]) == ("failed", reason), row


def test_its_own_reasons_are_counted_by_name() -> None:
    done = python("-c", COUNTED, json.dumps(SPEC), path=(TICKS,))
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == [None, 1.0, 2.0]
