"""Rows brought together, what was lost on their way, and what became of a case, by hand."""

from typing import Any

import pytest

from bagpipe.compare.changes import Change, changes
from bagpipe.compare.compare import compare
from bagpipe.compare.delivery import delivery
from bagpipe.compare.pairing import ROUNDS, Rounds, Series, Versions, recording_of, titles
from bagpipe.row_facts import key_of
from tests.unit.compare.rows import rounds, row

LOSS, DISCARDED = "delivery: loss", "delivery: discarded runs"


def ledger(*lines: tuple[int, int, int | None]) -> dict[str, Any]:
    """Of sent, received and dropped messages, each of a topic of its own."""
    return {
        "topics": [
            {"sent": sent, "subscribers": [{"received": received, "dropped": dropped}]}
            for sent, received, dropped in lines
        ]
    }


@pytest.mark.parametrize(
    ("lines", "percent"),
    [
        ([(100, 100, 0)], 0.0),
        ([(100, 90, 4)], 10.0),  # what is missing, also where nobody counted it as dropped
        ([(100, 90, None)], 10.0),
        ([(100, 90, 20)], 20.0),
        ([(100, 110, 0)], 0.0),
        ([(100, 110, 0), (100, 60, 0)], 20.0),
        ([(100, 100, 250)], 100.0),
        ([(300, 299, 1), (100, 97, 0)], 1.0),
        ([(1, 0, 0)], 100.0),
    ],
)
def test_loss_is_the_share_of_all_messages_that_did_not_arrive(
    lines: list[tuple[int, int, int | None]], percent: float
) -> None:
    found = delivery({"result": {"ledger": ledger(*lines)}})
    assert found == {LOSS: percent, DISCARDED: 0.0}


def test_all_runs_of_a_case_count_and_one_without_messages_says_nothing_of_loss() -> None:
    thrown = [{"ledger": ledger((100, 70, 0))}, {"ledger": None}, {}]
    measured = {"result": {"ledger": ledger((100, 100, 0))}, "evidence": None, "discarded": thrown}
    assert delivery(measured | {"attempts": 4}) == {LOSS: 15.0, DISCARDED: 3.0}
    assert delivery({"evidence": {"ledger": ledger((10, 9, 0))}})[LOSS] == 10.0
    assert delivery({"result": {"ledger": {"topics": [{"sent": 5}]}}}) == {DISCARDED: 0.0}
    assert delivery({"result": {"ledger": {"topics": None}}}) == {DISCARDED: 0.0}
    assert delivery({}) == {DISCARDED: 0.0}


def test_the_same_case_is_the_same_fragment_values_and_seed() -> None:
    assert key_of({"case": "c"}) == ("c", "{}", 0)
    assert key_of({"case": "c", "fragment": "f", "values": {"b": 1, "a": 2}, "seed": 3}) == (
        "f", '{"a": 2, "b": 1}', 3,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("played", "recording"),
    [
        ({"bag": "pvc://r/a.bag"}, "pvc://r/a.bag"),
        ({"bag": "sequence", "parts": [{"bag": "b"}, {"bag": "a"}, {"bag": "b"}]}, "a+b"),
        (
            {"bag": "s3://a/d/metadata.yaml", "parts": [{"bag": "s3://a/d/d_3.mcap"}]},
            "s3://a/d/metadata.yaml",
        ),
        ({"bag": "simulator", "seed": 7, "values": {"rain": 1}}, 'f {"rain": 1}'),
        ({"bag": "sequence", "parts": []}, "f {}"),
        ({}, "f {}"),
    ],
)
def test_what_was_played_is_a_bag_its_bags_or_a_world_of_any_seed(
    played: dict[str, Any], recording: str
) -> None:
    assert recording_of({"case": "c", "fragment": "f"} | played) == recording


def of(outcomes: str) -> Rounds:
    made = Rounds("a")
    for n, each in enumerate(rounds(0, "v", outcomes)):
        made.add(each | {"reason": "" if each["outcome"] == "passed" else f"Reason{n}"})
    return made


@pytest.mark.parametrize(
    ("outcomes", "passed", "steady", "worst", "reason"),
    [
        ("PPP", 3, True, "passed", ""),
        ("PPF", 2, False, "failed", "Reason2"),
        ("FEP", 1, False, "failed", "Reason0"),
        ("EFE", 0, True, "errored", "Reason0"),
        ("IEF", 0, True, "failed", "Reason2"),
        ("PIIF", 1, False, "invalid", "Reason1"),
    ],
)
def test_the_rounds_of_a_case_are_summarized_by_their_most_frequent_outcome(
    outcomes: str, passed: int, steady: bool, worst: str, reason: str
) -> None:
    found = of(outcomes)
    assert (found.passed, found.steady, found.worst) == (passed, steady, worst)
    assert found.reason_of(found.worst) == reason
    assert found.reason_of("no such outcome") == ""


def test_figures_are_kept_by_round_and_those_without_a_direction_or_a_number_are_none() -> None:
    criteria = [
        {"name": "delay", "kind": "own", "figure": 0.5, "unit": "s", "direction": "lower"},
        {"name": "seen", "figure": 7, "direction": ""},
        {"name": "rate", "figure": None, "unit": None, "direction": "higher"},
    ]
    rows = [row(0, "v", criteria=criteria), row(0, "v", "failed", criteria=None, round=1)]
    found = Versions.read([*rows, row(0, "w", figure=0.0)])
    [played] = found.of["v"].values()
    assert played.figures == {
        ("delay", "s", "own", "lower"): [0.5], ROUNDS: [100.0, 0.0],
        (DISCARDED, "runs", "", "lower"): [0.0, 0.0],
    }  # fmt: skip
    assert (played.cases, played.reasons) == (["a-0000-v"] * 2, ["", "Bad"])
    latency = Series("latency", "s", "", "lower")
    assert list(found.series) == [
        ("delay", "s", "own", "lower"), ("rate", "", "", "higher"), latency,
        (DISCARDED, "runs", "", "lower"), ROUNDS,
    ]  # fmt: skip
    assert next(iter(found.of["w"].values())).figures[latency] == [0.0]


@pytest.mark.parametrize(
    ("series", "names"),
    [
        ([("c", "s", "own", "lower"), ("d", "s", "own", "lower")], ["c", "d"]),
        ([("c", "s", "own", "lower"), ("c", "m", "own", "lower")], ["c (s)", "c (m)"]),
        ([("c", "", "error", "lower"), ("c", "", "expression", "higher")],
         ["c (error)", "c (expression)"]),
        ([("c", "m", "own", "lower"), ("c", "", "error", "lower")], ["c (m, own)", "c (error)"]),
        ([("c", "m", "own", "lower"), ("c", "m", "own", "higher")],
         ["c (lower is better)", "c (higher is better)"]),
    ],
)  # fmt: skip
def test_series_of_one_criterion_are_called_by_what_distinguishes_them(
    series: list[tuple[str, str, str, str]], names: list[str]
) -> None:
    assert list(titles(Series(*each) for each in series).values()) == names


def test_a_criterion_that_took_another_s_name_is_another_one() -> None:
    """An error in metres before, a share of messages now: figures of two kinds."""

    def judged(number: int, kind: str, figure: float, direction: str) -> dict[str, Any]:
        finding = {"name": "lane", "kind": kind, "figure": figure, "unit": ""}
        return row(number, "", criteria=[finding | {"direction": direction}])

    before = [judged(n, "error", 0.2, "lower") for n in range(12)]
    now = [judged(n, "expression", 0.9, "higher") for n in range(12)]
    for earlier, later in ((before, now), (now, before)):
        (found,) = compare(later, [], earlier)
        assert found.verdict == "same", found.message
        assert "measured no more: lane (" in found.message


@pytest.mark.parametrize(
    ("before", "after", "change"),
    [
        ("P", "P", Change("same")),
        ("P", "F", Change("regressed", "failed", "Reason0")),
        ("P", "I", Change("regressed", "invalid", "Reason0")),
        ("F", "P", Change("fixed")),
        ("F", "F", Change("same")),
        ("F", "E", Change("unknown")),
        ("E", "F", Change("unknown")),
        ("E", "E", Change("unknown")),
        ("E", "P", Change("unknown")),
        ("PF", "FP", Change("flaky")),
        ("PPPPPPPPPPPPPF", "PFFFFFFF", Change("regressed", "failed", "Reason1")),
        ("PFFFFFFF", "PPPPPPPPPPPPPF", Change("fixed")),
        ("PPPPP" + "F" * 25, "P" * 10, Change("fixed")),
        ("PPPPPPPPPP", "PPPPPPFFFF", Change("flaky")),
        # More rounds passed, and a smaller share of them.
        ("PPPPPPPP", "P" * 10 + "F" * 20, Change("regressed", "failed", "Reason10")),
    ],
)
def test_what_became_of_a_case(before: str, after: str, change: Change) -> None:
    key = ("f", "{}", 0)
    assert changes({key: of(before)}, {key: of(after)}) == {key: change}
    new = {("new", "{}", 0): of(after)}
    assert changes({key: of(before)}, new | {key: of(after)}) == {key: change}
    assert changes({}, new) == {}
