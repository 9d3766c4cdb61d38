"""The model of the set-up on more processors, against times that can be had by hand."""

import pytest

from tests.bench.set_up_cores import Step, critical, graph, shares, simulate, weighed

NOTHING: frozenset[str] = frozenset()
MAKE = """
A := $(STEP) "not a step"
# Files

goal: wide .venv
#  recipe to execute (from 'Makefile', line 86):
\t$(STEP) "Showing it" -- true

wide: first
\t$(STEP) "Computing" --if-it-fails "Again." -- \\
\t  compute

.venv: lock | first
\t$(call SYNC,,$@)

first:
\t$(STEP) "Checking" -- check
\t$(STEP) "Checking again" -- check

lock:
other: goal
\t$(STEP) "Nothing of the goal's" -- true
"""


def test_the_graph_is_makes_and_joins_steps_over_targets_without_one() -> None:
    assert graph(MAKE, "goal") == {
        "Checking": frozenset(),
        "Computing": frozenset({"Checking"}),
        "Making .venv from uv.lock": frozenset({"Checking"}),
        "Showing it": frozenset({"Computing", "Making .venv from uv.lock"}),
    }
    with pytest.raises(ValueError, match="no goal absent"):
        graph(MAKE, "absent")


def test_what_is_alone_uses_what_it_can() -> None:
    wide, narrow = Step("w", NOTHING, work=40, width=8), Step("n", NOTHING, work=40)
    assert [simulate([wide], count)["w"] for count in (1, 2, 4, 16)] == [40, 20, 10, 5]
    assert [simulate([narrow], count)["n"] for count in (1, 2, 4)] == [40, 40, 40]


def test_two_share_and_the_later_has_what_the_first_leaves() -> None:
    steps = [Step("a", NOTHING, work=10, width=8), Step("b", NOTHING, work=30, width=8)]
    assert simulate(steps, 2) == {"a": 10, "b": 20}


def test_what_waits_for_others_begins_when_all_have_ended() -> None:
    steps = [
        Step("a", NOTHING, work=10),
        Step("b", NOTHING, fixed=25),
        Step("c", frozenset({"a", "b"}), work=5),
    ]
    ends = simulate(steps, 4)
    assert ends == {"a": 10, "b": 25, "c": 30}
    assert critical(steps, ends, "c") == ["b", "c"]


def test_steps_that_wait_for_each_other_are_refused() -> None:
    with pytest.raises(ValueError, match=r"for ever: \['a', 'b'\]"):
        simulate([Step("a", frozenset({"b"})), Step("b", frozenset({"a"}))], 2)


def test_a_nice_step_has_less_and_takes_what_nobody_can_use() -> None:
    nice = Step("nice", NOTHING, width=8, niceness=5)
    equal = shares([Step("a", NOTHING, width=8), nice], 2)
    assert equal["a"] / equal["nice"] == pytest.approx(1.25**5)
    assert sum(equal.values()) == pytest.approx(2)
    beside = shares([Step("one", NOTHING), nice], 4)
    assert beside == pytest.approx({"one": 1, "nice": 3})


def test_times_are_of_the_processor_but_where_others_serve() -> None:
    measured: list[dict[str, float | str]] = [
        {"what": "Building Kubernetes", "seconds": 500, "processor": 400},
        {"what": "Loading images", "seconds": 30, "processor": 7},
    ]
    needs = {"Building Kubernetes": NOTHING, "Loading images": NOTHING, "Never run": NOTHING}
    assert weighed(needs, measured) == [
        Step("Building Kubernetes", NOTHING, work=400, width=64, niceness=19),
        Step("Loading images", NOTHING, fixed=30),
        Step("Never run", NOTHING),
    ]
