"""What a plan's estimate rests on: the recording's length, or what earlier cases took."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.cli.estimate import estimate, sentences
from bagpipe.plan.case import Case
from bagpipe.plan.expected import Earlier, earlier_of
from bagpipe.plan.fragments import Window
from bagpipe.spec import SimulationJobSpec
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish

SECOND = 10**9
MIB = 1 << 20


SPEC: dict[str, Any] = {
    "source": {"bags": ["pvc://recordings/*.bag"]},
    "stack": {"image": "i", "command": ["c"]},
    "record": {"topics": ["/out"]},
    "output": {"uri": "pvc://results/out"},
}
JOB = {
    "apiVersion": "sim.bagpipe.io/v1alpha1",
    "kind": "SimulationJob",
    "metadata": {"name": "lane"},
    "spec": SPEC,
}


def spec(**changed: Any) -> SimulationJobSpec:
    return SimulationJobSpec.model_validate(SPEC | changed)


def case(name: str, seconds: float = 20.0, size: int = MIB) -> Case:
    window = Window(SECOND, 3 * SECOND, SECOND + round(seconds * SECOND))
    return Case(f"{name}-x", "pvc://b", "v", window, [], [(0, size)], 1, fragment=name)


def row(name: str, seconds: Any, **more: Any) -> dict[str, Any]:
    window = [SECOND, 3 * SECOND, 21 * SECOND]
    return {"case": f"{name}-x", "fragment": name, "seconds": seconds, "window": window} | more


def test_real_time_takes_what_was_recorded_and_something_around() -> None:
    found = estimate(spec(), [case("a"), case("b"), case("c", 8.0)], Earlier())
    # 48 s of recording, lead-ins among them, and 2 to 20 s around each of three.
    assert found["wallSeconds"] == [54.0, 108.0]
    assert (found["slots"], found["bytes"], found["basis"]) == (1, 3 * MIB, {"recording": 3})
    faster = estimate(spec(playback={"rate": 2.0}), [case("a")], Earlier())
    assert faster["wallSeconds"] == [12.0, 30.0]


def test_slots_run_side_by_side_and_the_longest_case_bounds_them() -> None:
    wide = spec(spark={"executors": 2, "slots": 2})
    found = estimate(wide, [case(str(n)) for n in range(5)], Earlier())
    # Five of 22 to 40 s on four slots: at least a quarter of them, at most two after each other.
    assert found["wallSeconds"] == [27.5, 80.0]
    # Of executors that come and go: with all of them.
    breathing = spec(spark={"executors": {"min": 1, "max": 2}, "slots": 2})
    assert estimate(breathing, [case(str(n)) for n in range(5)], Earlier()) == found
    one = estimate(wide, [case("a", 100.0), case("b", 4.0)], Earlier())
    assert one["wallSeconds"] == [102.0, 120.0]


@pytest.mark.parametrize(
    "changed",
    [
        {"playback": {"mode": "max"}},
        {"playback": {"mode": "lockstep", "steps": [{"trigger": "/a", "answer": "/b"}]}},
        {"stack": {"image": "i", "command": ["c"], "engine": "exec"}, "record": None},
    ],
    ids=["max", "lockstep", "exec"],
)
def test_what_the_stack_decides_has_no_upper_end(changed: dict[str, Any]) -> None:
    found = estimate(spec(**changed), [case("a")], Earlier())
    assert (found["wallSeconds"], found["withoutBasis"]) == ([2.0, None], 1)
    text = "\n".join(sentences(found, "max"))
    assert "Estimate: at least 2 s on 1 slot" in text
    assert "How long 1 case may take in playback.mode: max is the stack's affair" in text


def test_earlier_results_bound_it_whatever_the_mode() -> None:
    earlier = earlier_of([row("a", 100.0), row("a", 300.0, attempts=3), row("b", 40.0)])
    cases = [case("a"), replace(case("b"), id="b-y"), case("c", 10.0)]
    found = estimate(spec(playback={"mode": "max"}), cases, earlier)
    # a: 100 s twice, one of them in three attempts; b by its fragment; c by 2 to 5 s a second.
    assert found["basis"] == {"case": 1, "fragment": 1, "others": 1}
    assert found["wallSeconds"] == [90.0 + 36.0 + 0.8 * 20.0, 125.0 + 50.0 + 1.5 * 50.0]
    assert found["withoutBasis"] == 0


@pytest.mark.parametrize("seconds", [None, "12", 0, -3.0, float("inf"), float("nan")])
def test_a_line_without_a_time_says_nothing(seconds: Any) -> None:
    assert earlier_of([row("a", seconds)]) == Earlier()


def test_memory_is_compared_with_the_limit() -> None:
    measured = {
        "stack": {"usage": {"peak_memory_bytes": 300 * MIB}},
        "recorded": {"high_water_bytes": 50 * MIB},
    }
    earlier = earlier_of([row("a", 9.0, result=measured), row("b", 9.0, result=None)])
    stack = {"image": "i", "command": ["c"], "resources": {"limits": {"memory": "1Gi"}}}
    wide = spec(stack=stack, spark={"slots": 2})
    found = estimate(wide, [case("a", size=100 * MIB)], earlier)["memory"]
    # Two slots of fragment, stack, recording and agent; and the pipes.
    assert found["executor"] == 2 * (100 + 300 + 50 + 5) * MIB + 64 * MIB
    assert found["limit"] == 1024 * MIB
    large = estimate(wide, [case("a", size=200 * MIB)], earlier)
    assert any("ABOVE its limit 1 GiB" in line for line in sentences(large, "realtime"))
    unknown = sentences(estimate(spec(), [case("a")], Earlier()), "realtime")[-1]
    assert "what the stack itself takes is not known" in unknown
    assert unknown.endswith("without a limit (stack.resources.limits).")


def test_a_driver_with_more_cases_than_it_holds_is_named_with_its_limit() -> None:
    many = [case("a")] * 200_000
    found = estimate(spec(), many, Earlier())
    # The heap of half a gigabyte, 250 MiB beside it, 95 of Python, and 1.5 KiB for each case.
    assert found["memory"]["driver"] == (512 + 250 + 95) * MIB + 200_000 * 1536
    assert found["memory"]["driverLimit"] == 1024 * MIB
    assert sentences(found, "realtime")[-1] == (
        "  Memory of the driver: 1.12 GiB with 200,000 cases, ABOVE its limit 1 GiB: raise"
        " spark.driver.resources.memory."
    )
    raised = spec(spark={"driver": {"resources": {"memory": "2Gi"}}})
    wide = estimate(raised, many, Earlier())
    assert wide["memory"]["driver"] == (1024 + 250 + 95) * MIB + 200_000 * 1536
    few = estimate(spec(), [case("a")] * 1000, Earlier())
    for each in (wide, few):
        assert not any("of the driver" in line for line in sentences(each, "realtime"))


def test_a_plan_without_a_case_takes_nothing() -> None:
    found = estimate(spec(), [], Earlier())
    assert (found["wallSeconds"], found["memory"]["fragment"]) == ([0.0, 0.0], 0)
    assert "nothing: there is no case" in sentences(found, "realtime")[1]


def test_the_verb_shows_it(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 100, 50_000_000))
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(JOB))
    words = ["plan", str(tmp_path / "job.yaml"), "--volume", f"recordings={tmp_path}"]
    done = CliRunner().invoke(main, words)
    assert "Estimate: 7 s to 25 s on 1 slot" in done.output, done.output
    results = publish(tmp_path, [make_row("a-0000", seconds=1000.0)])
    done = CliRunner().invoke(main, [*words, "--results", str(results), "--output", "json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["estimate"]["wallSeconds"] == [900.0, 1250.0]
    done = CliRunner().invoke(main, [*words, "--results", str(tmp_path / "none")])
    assert (done.exit_code, "no folder of this machine" in done.output) == (2, True)


def test_recordings_that_are_elsewhere_have_no_estimate(tmp_path: Path) -> None:
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(JOB))
    done = CliRunner().invoke(main, ["plan", str(tmp_path / "job.yaml"), "--output", "json"])
    assert json.loads(done.stdout)["estimate"] is None
