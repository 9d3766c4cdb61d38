"""What of a comparison speaks against a job, and what is allowed."""

import pytest

from bagpipe.compare.gate import CAUSES, objections
from tests.unit.compare.rows import only, rounds, row


def causes(rows: list[dict[str, object]], *allowed: str) -> list[str]:
    found = objections(only(rows).as_json(), allowed)
    return [objection.cause for objection in found]


BOTH = [row(0, "released"), row(0, "pr-812")]
WORSE_LATENCY = [
    row(n, v, figure=1.0 + n / 100 + (v == "pr-812"))
    for n in range(6)
    for v in ("released", "pr-812")
]


@pytest.mark.parametrize(
    ("rows", "cause"),
    [
        ([*BOTH, row(1, "released"), row(1, "pr-812", "failed")], "Regressed"),
        ([*BOTH, row(1, "released"), row(1, "pr-812", "invalid")], "Regressed"),
        ([*BOTH, row(1, "released"), row(1, "pr-812", "errored")], "Regressed"),
        ([*BOTH, row(1, "released")], "Missing"),
        ([*BOTH, row(1, "released", "failed")], "Missing"),
        (WORSE_LATENCY, "WorseCriteria"),
        ([row(0, "released", "errored"), row(0, "pr-812")], "Unknown"),
        ([row(0, "pr-812")], "Unknown"),
    ],
)
def test_each_cause_alone_speaks_against_a_job_unless_it_is_allowed(
    rows: list[dict[str, object]], cause: str
) -> None:
    assert causes(rows) == [cause]
    assert causes(rows, cause) == []
    assert causes(rows, *(other for other in CAUSES if other != cause)) == [cause]


def test_nothing_speaks_against_what_is_the_same_or_better() -> None:
    assert causes(BOTH) == []
    assert causes([row(0, "released", "failed"), row(0, "pr-812")]) == []


def test_each_says_how_many_and_of_which_variant() -> None:
    rows = [*BOTH, *(row(n, "released") for n in (1, 2, 3)), row(1, "pr-812", "failed"),
            row(2, "pr-812", "errored")]  # fmt: skip
    assert [each.message for each in objections(only(rows).as_json())] == [
        "pr-812 against released: 2 regressed (1 failed, 1 errored)",
        "pr-812 against released: 1 missing",
    ]


def test_each_says_which_criteria_and_that_nothing_could_be_compared() -> None:
    [worse] = objections(only(WORSE_LATENCY).as_json())
    assert worse.message == "pr-812 against released: worse in latency"
    rows = [row(0, "released", "errored"), row(0, "pr-812")]
    [unknown] = objections(only(rows).as_json())
    assert unknown.message == "pr-812 against released: no case of both could be compared"


def test_a_comparison_with_an_earlier_job_is_this_job_s() -> None:
    earlier = only([*BOTH, row(1, "released")]).as_json() | {"variant": "", "baseline": "nightly-7"}
    assert [each.message for each in objections(earlier)] == [
        "this job against nightly-7: 1 missing"
    ]


def test_what_was_compared_though_it_is_flaky_or_fixed_is_not_unknown() -> None:
    for before, after in (("PF", "PF"), ("FF", "PP")):
        rows = [*rounds(0, "released", before), *rounds(0, "pr-812", after)]
        assert causes(rows) == []
