"""Figures of all kinds: what is infinite, far apart or of two units hides and invents nothing."""

from typing import Any

from bagpipe.compare.compare import compare
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion
from tests.unit.compare.rows import row
from tests.unit.evaluate.recordings import evidence

INFINITE = float("inf")


def rows(variant: str, figures: list[float], direction: str = "lower") -> list[dict[str, Any]]:
    return [
        row(n, variant, figure=figure, direction=direction, bag=f"pvc://b/{n}.bag")
        for n, figure in enumerate(figures)
    ]


def verdict(before: list[float], after: list[float], direction: str) -> str:
    both = [*rows("released", before, direction), *rows("pr-812", after, direction)]
    [found] = compare(both, ["released", "pr-812"])
    return found.verdict


def test_one_recording_in_which_nothing_ever_comes_near_blinds_no_criterion() -> None:
    """Times to a collision: from 8 s to 1.1 s in ten recordings; in one nobody comes near."""
    before, after = [8.0 + n / 10 for n in range(10)], [1.1 + n / 10 for n in range(10)]
    assert verdict(before, after, "higher") == "worse"
    assert verdict([*before, INFINITE], [*after, INFINITE], "higher") == "worse"


def test_what_is_infinite_where_all_else_is_nought_differs_from_it() -> None:
    noughts = [0.0] * 12
    assert verdict(noughts, [INFINITE] * 12, "lower") == "worse"
    assert verdict([INFINITE] * 12, noughts, "lower") == "better"
    assert verdict(noughts, noughts, "lower") == "same"


def test_a_recording_that_got_much_worse_makes_no_version_less_worse() -> None:
    """An error of millimetres everywhere, and one filter that diverges."""
    before = [0.010, 0.011, 0.012, 0.013, 0.014]
    worse = [each + 0.005 for each in before]
    assert verdict(before, worse, "lower") == "worse"
    assert verdict(before, [*worse[:4], 1e10], "lower") == "worse"


def used(cpu: float) -> dict[str, Any]:
    """10 s of CPU time and a peak of 100 MiB."""
    criterion = Criterion.model_validate(
        {"name": "use", "resources": {"maxCpu": 1.0, "maxMemory": "1Gi", "minCoverage": 0}}
    )
    usage = {"seconds": 10.0, "cpu_seconds": 10 * cpu, "peak_memory_bytes": 100 << 20}
    result = {"stack": {"usage": usage}, "timings": {"play": 10.0}}
    [finding] = evaluate([criterion], evidence([], result=result))
    return finding.as_row()


def test_a_version_that_mends_its_cpu_is_not_worse() -> None:
    """It used 1.5 CPUs and failed; it uses 0.5 of them, and as much memory as before."""
    made: list[dict[str, Any]] = []
    for n in range(6):
        for variant, cpu, outcome in (("released", 1.5, "failed"), ("pr-812", 0.5, "passed")):
            more = {"criteria": [used(cpu + n / 100)], "bag": f"pvc://b/{n}.bag"}
            made.append(row(n, variant, outcome) | more)
    [found] = compare(made, ["released", "pr-812"])
    assert found.counts["fixed"] == 6
    assert found.verdict == "better", found.message
    names = [one.name for one in found.criteria if one.name.startswith("use")]
    assert names == ["use (CPUs)", "use (bytes)"]


def test_executors_that_were_taken_away_make_no_version_worse() -> None:
    """Six recordings whose executors were drained once: `starts` is 2, and nobody is at fault."""
    before = [row(n, "", bag=f"pvc://b/{n}.bag", attempts=1, starts=1) for n in range(6)]
    after = [row(n, "", bag=f"pvc://b/{n}.bag", attempts=1, starts=2) for n in range(6)]
    [found] = compare(after, [], before)
    assert found.verdict == "same", found.message
