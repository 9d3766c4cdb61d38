"""source.simulator in a job: refusals that say what to write, the plan, and the verdict's part."""

import copy
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner
from pydantic import ValidationError

from bagpipe.cli.__main__ import main
from bagpipe.judgement import Judgement
from bagpipe.matrix.faults import MatrixError
from bagpipe.simulator.model import START
from bagpipe.source.planning import plan
from bagpipe.source.simulator.planning import scenario_of
from bagpipe.source.simulator.steering import judge_steering
from bagpipe.spec import SimulationJobSpec, claims
from bagpipe.storage import Storage

MANIFEST = Path(__file__).parents[3] / "docs/examples/barrier-car/job.yaml"
EXAMPLE: dict[str, Any] = yaml.safe_load(MANIFEST.read_text())["spec"]
MOTIONS = ["straight", "left", "right"]
# The paper's combinations without those in which the cars only part, in the plan's order.
CASES = [
    *[("front", speed, motion) for speed in ("slower", "equal") for motion in MOTIONS],
    *[("front-left", speed, motion) for speed in ("slower", "equal") for motion in MOTIONS],
    *[("left", speed, motion) for speed in ("slower", "equal", "faster") for motion in MOTIONS],
    *[("rear-left", speed, motion) for speed in ("equal", "faster") for motion in MOTIONS],
    *[("rear", speed, motion) for speed in ("equal", "faster") for motion in MOTIONS],
    *[("rear-right", speed, motion) for speed in ("equal", "faster") for motion in MOTIONS],
    *[("right", speed, motion) for speed in ("slower", "equal", "faster") for motion in MOTIONS],
    *[("front-right", speed, motion) for speed in ("slower", "equal") for motion in MOTIONS],
]


def job(change: dict[str, Any] | None = None, **simulator: Any) -> SimulationJobSpec:
    """The example with fields of the spec, and of its simulator, replaced; None removes."""
    fields = copy.deepcopy(EXAMPLE)
    fields["source"]["simulator"] |= simulator
    for name, value in (change or {}).items():
        fields[name] = value
        if value is None:
            del fields[name]
    return SimulationJobSpec.model_validate(fields)


def test_the_barrier_car_has_exactly_the_paper_s_cases() -> None:
    cases = sorted(plan(job(), Storage({})).cases, key=lambda case: case.id)
    values = [tuple(case.conditions.values.values()) for case in cases]
    assert values == CASES
    assert len(CASES) == 54
    assert (cases[0].id, cases[-1].id) == ("drive-s00", "drive-s68")
    windows = {(c.window.lead_in_start, c.window.start, c.window.end) for c in cases}
    assert windows == {(START, START, START + 10_000_000_000)}
    assert {(case.bag, case.bytes, case.messages) for case in cases} == {("simulator", 0, 100)}


def test_the_plan_shows_what_is_left_out_and_why() -> None:
    shown = CliRunner().invoke(main, ["plan", str(MANIFEST)], env={"COLUMNS": "160"})
    assert shown.exit_code == 0, shown.output
    assert "the barrier car drives away from us" in shown.output
    assert "the barrier car falls behind" in shown.output
    assert "54 cases: 1 fragment, each under 54 conditions." in shown.output


def test_values_of_the_matrix_reach_the_scenario() -> None:
    spec = job()
    by_name = {case.id: case for case in plan(spec, Storage({})).cases}
    scenario = scenario_of(spec.source.own, by_name["drive-s52"].conditions)
    (actor,) = scenario.actors
    assert (actor.start.direction, actor.speed, actor.motion) == ("rear-right", "faster", "left")
    assert scenario.ego.speed == 20


STEP = {"trigger": "/ego/odom", "answer": "/cmd"}


@pytest.mark.parametrize(
    ("change", "simulator", "words"),
    [
        ({"playback": {"mode": "max"}}, {}, "write playback.mode: lockstep"),
        ({"playback": {"mode": "lockstep", "steps": [STEP | {"answer": "/x"}]}}, {},
         r"no step of playback.steps has the answer /cmd.*\{trigger: /ego/odom, answer: /cmd\}"),
        ({"playback": {"mode": "lockstep", "steps": [STEP | {"trigger": "/x"}]}}, {},
         "the step's trigger /x is no topic of the simulator: it has /ego/odom"),
        ({"stack": {"image": "i", "command": ["c"], "remap": {"/a": "/b"}}}, {},
         "write the stack's names into source.simulator.topics"),
        ({"stack": {"image": "i", "command": ["c"], "engine": "exec"}, "evaluate": []}, {},
         "speaks ROS 1"),
        ({"evaluate": [{"name": "e", "error": {"topic": "/ego/odom", "fields": ["a"], "max": 1,
                                               "recording": True}}]}, {}, "has no bag"),
        ({}, {"duration": "50ms"}, "must be 1 to 100000 times its step"),
        ({}, {"duration": "10"}, "write for example 100ms or 20s"),
        ({}, {"step": "0.5ms"}, "shorter than 1ms"),
        ({}, {"topics": {"control": "cmd"}}, "write for example /ego/odom"),
        ({}, {"topics": {"scene": "/ego/odom"}}, "have one name"),
        ({}, {"actors": [], "ego": {"lane": 7}}, "counted from 0 at the right"),
        ({"source": EXAMPLE["source"] | {"bags": ["pvc://a/b"]}}, {}, "or source.simulator"),
        ({"source": EXAMPLE["source"] | {"topics": ["/tf"]}}, {}, "source.simulator.topics"),
    ],
)  # fmt: skip
def test_refusals_say_what_to_write(
    change: dict[str, Any], simulator: dict[str, Any], words: str
) -> None:
    with pytest.raises(ValidationError, match=words):
        job(change, **simulator)


def test_what_the_simulator_says_is_recorded_and_may_be_judged() -> None:
    spec = job({"record": {"topics": ["/cmd"]}})
    assert spec.evaluate[1].expression is not None
    with pytest.raises(ValidationError, match=r"which record\.topics does not have"):
        job({"evaluate": [{"name": "x", "presence": {"topic": "/other"}}]})


def test_a_simulator_reads_no_volume() -> None:
    assert claims(job()) == {"results": False}


def test_a_scenario_of_one_combination_that_makes_no_sense_stops_the_plan() -> None:
    actors = [{"start": {"direction": "{{ direction }}"}, "speed": "{{ motion }}"}]
    with pytest.raises(MatrixError, match=r"source.simulator.actors.0.speed.*direction = front"):
        plan(job(actors=actors), Storage({}))
    with pytest.raises(MatrixError, match="which is no variable"):
        plan(job(actors=[{"start": {"direction": "{{ nowhere }}"}}]), Storage({}))


def test_a_drive_that_nobody_steered_proves_nothing() -> None:
    passed = Judgement("passed")
    steps = [{"answer": "/cmd", "answered": 0}, {"answer": "/other", "answered": 9}]
    judged = judge_steering({"playback": {"steps": steps}}, passed, "/cmd")
    assert (judged.outcome, judged.reason) == ("invalid", "NothingAnswered")
    steps[0]["answered"] = 1
    assert judge_steering({"playback": {"steps": steps}}, passed, "/cmd") is passed
