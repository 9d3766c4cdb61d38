"""A criterion with several bounds is compared by each of its figures, whichever decided."""

from typing import Any

import pytest

from bagpipe.compare.compare import Comparison, compare
from bagpipe.evaluate.finding import Finding
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion
from tests.unit.compare.rows import row
from tests.unit.evaluate.recordings import evidence, poses, stamped


def judged(wanted: dict[str, Any], given: Any) -> Finding:
    [found] = evaluate([Criterion.model_validate({"name": "c"} | wanted)], given)
    assert found.outcome == "passed", found
    return found


def used(cpu: float) -> Finding:
    given = evidence([("/ego", 10, stamped(10, 0, 0))])
    usage = {"seconds": 10.0, "cpu_seconds": 10 * cpu, "peak_memory_bytes": 1 << 30}
    given.result["stack"] = {"usage": usage}
    return judged({"resources": {"maxCpu": 1.5, "maxMemory": "2Gi"}}, given)


def near(distance: float) -> Finding:
    """The same time to a collision (never), at another distance."""
    entries = [("/ego", 10 + i, stamped(10 + i, 0, 0)) for i in range(10)]
    entries += [("/cars", 10 + i, poses(10 + i, (distance, 0))) for i in range(10)]
    bounds = {"minDistance": 2, "minTimeToCollision": 1, "radius": 0.5}
    return judged({"separation": {"ego": "/ego", "obstacles": "/cars"} | bounds}, evidence(entries))


def turned(yaw: float) -> Finding:
    given = evidence([("/pose", 19.9, stamped(19.9, 1, 0, yaw))])
    goal = {"topic": "/pose", "position": [0, 0], "yaw": 0, "maxDistance": 2, "maxYawError": 1}
    return judged({"finalPose": goal}, given)


def rows(finding: dict[str, Any]) -> list[dict[str, Any]]:
    return [row(n, "", criteria=[finding]) for n in range(12)]


def against(before: dict[str, Any], now: dict[str, Any]) -> Comparison:
    [found] = compare(rows(now), [], rows(before))
    return found


@pytest.mark.parametrize(
    ("before", "now", "unit"),
    [(used(0.5), used(1.4), "CPUs"), (near(50), near(6), "m"), (turned(0.1), turned(0.9), "rad")],
)
def test_what_got_worse_within_its_bound_is_compared_too(
    before: Finding, now: Finding, unit: str
) -> None:
    found = against(before.as_row(), now.as_row())
    assert found.verdict == "worse", found.message
    assert [each.name for each in found.criteria if each.verdict == "worse"] == [f"c ({unit})"]
    assert against(now.as_row(), before.as_row()).verdict == "better"


def test_results_of_before_have_the_figure_that_decided_and_are_compared_by_it() -> None:
    earlier = {key: value for key, value in used(0.5).as_row().items() if key != "figures"}
    found = against(earlier, used(1.4).as_row())
    assert found.verdict == "same"
    assert {each.name: each.pairs for each in found.criteria} == {"c (bytes)": 12, "c (CPUs)": 0}
    assert "measured no more" not in found.message
    assert "measured no more: c (CPUs)" in against(used(1.4).as_row(), earlier).message


def test_a_figure_whose_other_way_is_better_now_is_named_and_not_compared() -> None:
    """As of a rate that had a least one and has a greatest one now."""
    before = turned(0.5).as_row()
    other = {"lower": "higher", "higher": "lower"}
    figures = [each | {"direction": other[each["direction"]]} for each in before["figures"]]
    now = before | {"direction": other[before["direction"]], "figures": figures}
    found = against(before, now)
    assert "not compared, as the other way is better now: c" in found.message
    assert "measured no more" not in found.message
    assert "the other way" not in against(before, before).message
