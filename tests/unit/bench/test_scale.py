"""The scale bench's rows: a driver that takes too much for each case fails the gate."""

from tests.bench import run, scale, scale_planning
from tests.bench.rows import Row
from tests.bench.scale_fleet import Planned

FEW = Planned(100, 1.0, before=80.0, most=90.0, jvm=300.0)


def for_each(most: float) -> Row:
    """The memory for each of 1,024 cases when 80 MiB have grown to `most`."""
    rows = scale._driver(FEW, Planned(1024, 2.0, before=80.0, most=most, jvm=400.0))
    (found,) = [row for row in rows if row.metric == "driver's memory for each"]
    return found


def test_a_case_that_takes_more_memory_than_its_budget_is_missed() -> None:
    assert for_each(83.0).ours == [3.0]
    assert not for_each(83.0).missed
    assert for_each(85.0).missed


def test_the_jvms_memory_is_a_row_of_its_own() -> None:
    rows = scale._driver(FEW, Planned(1024, 2.0, before=80.0, most=81.0, jvm=400.0))
    (jvm,) = [row for row in rows if row.metric == "driver's JVM memory"]
    assert (jvm.ours, jvm.theirs) == ([400.0], [300.0])


def test_every_file_is_planned_in_every_round() -> None:
    rates = scale_planning.planned(20, rounds=2)
    assert len(rates) == 2
    assert min(rates) > 0
    (row,) = scale._plans({20: rates, 40: [7.0]})
    assert (row.case, row.peer, row.ours, row.theirs) == ("40 cases", "20 cases", [7.0], rates)


def test_the_parts_of_a_bench_are_no_benches() -> None:
    assert [name for name in run.benches() if name.startswith("scale")] == ["scale"]
