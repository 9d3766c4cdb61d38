"""Some of a plan's cases, by number and by name."""

import re

import pytest

from bagpipe.driver.chosen import NoCaseError, check_named, chosen
from bagpipe.plan.case import Case
from bagpipe.plan.fragments import Window
from bagpipe.plan.made import Plan, Unplanned


def case(name: str) -> Case:
    return Case(name, "pvc://r/a.bag", "v", Window(0, 0, 1), [], [], 1)


LOST = Unplanned("lost", "pvc://r/lost.bag", "BagMissing", "no file")
# The biggest case is first, as plans have it, whatever its name.
PLAN = Plan([case("b-0001"), case("a-0002"), case("a-0001"), case("b-0000")], [LOST])


@pytest.mark.parametrize(
    ("wanted", "names", "bags"),
    [
        ([], ["b-0001", "a-0002", "a-0001", "b-0000"], ["lost"]),
        (["2"], ["a-0002", "a-0001"], ["lost"]),
        (["9"], ["b-0001", "a-0002", "a-0001", "b-0000"], ["lost"]),
        (["b-*"], ["b-0001", "b-0000"], []),
        (["a-0001", "b-0000"], ["a-0001", "b-0000"], []),
        (["?-*", "1"], ["a-0001"], []),
        (["lost"], [], ["lost"]),
    ],
)
def test_what_is_wanted_is_left_in_the_plan_s_order(
    wanted: list[str], names: list[str], bags: list[str]
) -> None:
    left = chosen(PLAN, wanted)
    assert [each.id for each in left.cases] == names
    assert [each.id for each in left.unplanned] == bags


def test_names_that_nothing_has_are_refused_with_the_first_that_there_is() -> None:
    with pytest.raises(NoCaseError, match=r"none of the 4 cases is called x\* or y; the first is"):
        chosen(PLAN, ["x*", "y"])
    with pytest.raises(NoCaseError, match="the first is a-0001"):
        chosen(PLAN, ["0", "x*"])
    with pytest.raises(NoCaseError, match="the first is a-0001"):
        chosen(Plan(PLAN.cases, []), ["x*"])


def test_a_name_that_is_not_there_where_a_recording_gave_no_case_says_why() -> None:
    with pytest.raises(NoCaseError) as refused:
        chosen(Plan(PLAN.cases, [LOST, LOST]), ["drive-0000"])
    assert str(refused.value) == (
        "none of the 4 cases is called drive-0000; the first is a-0001: `bagpipe plan` lists them"
        " all. 2 recordings gave none, the first pvc://r/lost.bag: no file"
    )


def test_where_nothing_could_be_planned_that_is_what_is_left() -> None:
    nothing = Plan([], [LOST])
    assert chosen(nothing, ["drive-0000"]) == nothing


def test_a_plan_of_nothing_stays_one() -> None:
    assert chosen(Plan([], []), ["x"]) == Plan([], [])


@pytest.mark.parametrize("known", [[], ["a-0001"], ["lost"], ["?-*", "1"], ["b-*", "a-0002", "2"]])
def test_each_name_that_is_wanted_is_there(known: list[str]) -> None:
    check_named(PLAN, known)
    for unknown in ("nihgt-0003", "lost-0000", "c*"):
        with pytest.raises(NoCaseError, match=re.escape(f"is called {unknown}; the first is a-")):
            check_named(PLAN, [*known, unknown])


def test_where_nothing_could_be_planned_no_name_is_missed() -> None:
    check_named(Plan([], [LOST]), ["drive-0000"])
