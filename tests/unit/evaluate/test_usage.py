"""What the stack used, to the figure and the word."""

from dataclasses import replace
from typing import Any

import pytest

from bagpipe.evaluate.finding import Figure, Finding
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion
from tests.unit.evaluate.recordings import evidence

MEBIBYTE = 1 << 20
WHOLE = "10.0 s of the 10.0 s that were played"


def found(result: dict[str, Any], end: float = 20.0, **wanted: Any) -> Finding:
    criterion = Criterion.model_validate({"name": "use", "resources": wanted})
    [finding] = evaluate([criterion], evidence([], result=result, end=end))
    figures = tuple(replace(each, measures="") for each in finding.figures)
    return replace(finding, measures="", figures=figures)


def used(seconds: float, timings: dict[str, float] | None = None) -> dict[str, Any]:
    usage = {"seconds": seconds, "cpu_seconds": 4.0, "peak_memory_bytes": 3 * MEBIBYTE}
    return {"stack": {"usage": usage}, "timings": timings}


def test_cpu_is_what_was_used_in_a_second_of_the_stack() -> None:
    finding = Finding(
        "use", "resources", "passed", 0.4, "CPUs", "at most 0.5 CPUs", "lower",
        "0.4 CPUs used over 10.0 s", coverage=1.0, covered=WHOLE,
    )  # fmt: skip
    assert found(used(10.0), maxCpu=0.5) == finding
    assert found(used(10.0), maxCpu=0.4).outcome == "passed"
    assert found(used(10.0), maxCpu=0.39).message == (
        "0.4 CPUs used over 10.0 s, and may be at most 0.39 CPUs"
    )


def test_memory_is_the_most_at_one_time() -> None:
    assert found(used(10.0), maxMemory="3Mi") == Finding(
        "use", "resources", "passed", 3145728.0, "bytes", "at most 3.14573e+06 bytes", "lower",
        "3.14573e+06 bytes at most at one time", coverage=1.0, covered=WHOLE,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("limit", "count"),
    [("1", 1), ("1k", 10**3), ("1M", 10**6), ("1G", 10**9), ("1T", 10**12), ("1Ki", 2**10),
     ("1.5Mi", 3 * 2**19), ("1Gi", 2**30), ("1Ti", 2**40)],
)  # fmt: skip
def test_a_limit_of_memory_is_so_many_bytes(limit: str, count: int) -> None:
    for peak, outcome in ((count, "passed"), (count + 1, "failed")):
        given: dict[str, Any] = {"stack": {"usage": {"seconds": 10.0, "peak_memory_bytes": peak}}}
        assert found(given, maxMemory=limit).outcome == outcome


def test_of_two_limits_the_memory_is_reported_unless_the_cpu_is_too_much() -> None:
    assert found(used(10.0), maxCpu=0.4, maxMemory="3Mi").unit == "bytes"
    assert found(used(10.0), maxCpu=0.3, maxMemory="3Mi").unit == "CPUs"


def test_of_two_limits_both_figures_are_kept_whichever_decides() -> None:
    memory = Figure("passed", 3145728.0, "bytes", "at most 3.14573e+06 bytes", "lower")
    for most, outcome in ((0.4, "passed"), (0.3, "failed")):
        finding = found(used(10.0), maxCpu=most, maxMemory="3Mi")
        cpu = Figure(outcome, 0.4, "CPUs", f"at most {most} CPUs", "lower")  # type: ignore[arg-type]
        assert (finding.outcome, finding.figures) == (outcome, (cpu, memory))
    row = finding.as_row()
    assert [each["figure"] for each in row["figures"]] == [0.4, 3145728.0]
    assert "figures" not in found(used(10.0), maxCpu=0.3).as_row()
    # What is too much is too much, whatever else was not measured.
    unknown: dict[str, Any] = {"stack": {"usage": {"seconds": 10.0, "cpu_seconds": 4.0}}}
    assert found(unknown, maxCpu=0.3, maxMemory="3Mi").figures == ()
    assert found(unknown, maxCpu=0.3, maxMemory="3Mi").outcome == "failed"
    assert found(unknown, maxCpu=0.4, maxMemory="3Mi").outcome == "invalid"


@pytest.mark.parametrize(
    ("seconds", "timings", "coverage", "covered"),
    [
        (5.0, None, 0.5, "5.0 s of the 10.0 s that were played"),
        (12.0, None, 1.0, WHOLE),
        # By the agent's clock, without what went before the play.
        (8.0, {"play": 4.0, "subscribe": 1.0, "lead_in": 4.5}, 0.625, "2.5 s of the 4.0 s"),
        (8.0, {"play": 4.0, "subscribe": 5.0, "lead_in": 4.5}, 0.0, "0.0 s of the 4.0 s"),
        (8.0, {"play": 4.0}, 1.0, "4.0 s of the 4.0 s"),
        (8.0, {"play": 0.0}, 1.0, "0.0 s of the 0.0 s"),
        (0.25, {"play": 0.5}, 0.5, "0.2 s of the 0.5 s"),
        (8.0, {"play": 10.0, "subscribe": 1.0}, 0.7, "7.0 s of the 10.0 s"),
        (8.0, {"play": 10.0, "lead_in": 2.0}, 0.6, "6.0 s of the 10.0 s"),
    ],
)
def test_it_is_judged_on_the_part_of_the_play_that_the_stack_was_there_for(
    seconds: float, timings: dict[str, float] | None, coverage: float, covered: str
) -> None:
    finding = found(used(seconds, timings), maxCpu=9, minCoverage=0)
    assert (finding.coverage, finding.clock) == (coverage, "none")
    assert finding.covered.startswith(covered)


def test_a_part_shows_that_a_peak_was_too_high_and_nothing_else() -> None:
    for wanted, outcome in (
        ({"maxMemory": "2Mi"}, "failed"),
        ({"maxMemory": "4Mi"}, "invalid"),
        ({"maxCpu": 0.1}, "invalid"),
        ({"maxCpu": 9}, "invalid"),
    ):
        assert found(used(5.0), **wanted).outcome == outcome
    assert found(used(5.0), maxCpu=9).message == (
        "judged on 5.0 s of the 10.0 s that were played, which is 50%, and at least 90% are"
        " needed: the stack ended early, or lower minCoverage; 0.8 CPUs used over 5.0 s"
    )


def test_what_was_not_measured_is_reported() -> None:
    for result in ({}, {"stack": None}, {"stack": {"usage": None}}):
        cpu, memory = found(result, maxCpu=1), found(result, maxMemory="1G")
        assert (cpu.outcome, memory.outcome) == ("invalid", "invalid")
        assert cpu.message == "the stack's CPU time was not measured in this case"
        assert memory.message == "the stack's memory was not measured in this case"
    idle = {"stack": {"usage": {"seconds": 0.0, "cpu_seconds": 0.0}}}
    assert found(idle, maxCpu=1).message == cpu.message


def test_a_window_without_length_is_covered() -> None:
    finding = found(used(5.0), end=10.0, maxCpu=9)
    assert (finding.outcome, finding.coverage) == ("passed", 1.0)


def test_a_peak_that_nobody_says_the_length_of_covers_nothing() -> None:
    given: dict[str, Any] = {"stack": {"usage": {"peak_memory_bytes": 3 * MEBIBYTE}}}
    finding = found(given, maxMemory="4Mi")
    assert (finding.outcome, finding.coverage) == ("invalid", 0.0)
    assert found(given, maxMemory="2Mi").outcome == "failed"
