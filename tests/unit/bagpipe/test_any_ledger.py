"""What holds of the judgement on any ledger, whatever nodes lost and whatever the machine did."""

import copy
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from bagpipe.engine.delivery import judge

Json = dict[str, Any]
NODES = ("/a", "/b", "/c")
seconds = st.floats(0, 20, allow_nan=False)
figures = st.floats(0, 2, allow_nan=False)
modes = st.sampled_from(["realtime", "realtime", "max", "lockstep"])
lines: st.SearchStrategy[Json] = st.fixed_dictionaries(
    {
        "node": st.sampled_from(NODES),
        "lacks": st.integers(0, 40) | st.just(0),
        "more": st.sampled_from([0] * 20 + [1, 3]),
        "dropped": st.integers(0, 5) | st.just(0),
        "waited_seconds": st.none() | figures,
    }
)
topics = st.tuples(
    st.integers(0, 50), st.lists(lines, min_size=1, max_size=3, unique_by=lambda x: x["node"])
)
# What hides all that comes after it is rare.
ends = st.integers(0, 9).flatmap(
    lambda chance: st.lists(
        st.sampled_from(["StackCrashed", "NodeGone", "StackExited"]),
        max_size=2 if chance == 0 else 0,
    )
)
busy = st.integers(0, 3).map(bool)
many = settings(max_examples=250)


@st.composite
def results(draw: st.DrawFn) -> Json:
    """RESULT maps as an agent may send them, and some that none would."""
    topics_played = []
    for number, (sent, subscribers) in enumerate(draw(st.lists(topics, min_size=1, max_size=2))):
        rows = []
        for line in subscribers:
            row = {key: line[key] for key in ("node", "dropped", "waited_seconds")}
            rows.append(row | {"received": max(0, sent - line["lacks"]) + line["more"]})
        topics_played.append({"topic": f"/t{number}", "sent": sent, "subscribers": rows})
    stood = {"stall_max_seconds": draw(figures), "late_max_seconds": draw(figures)}
    return {
        "stack": {"ended": [{"cause": cause, "message": "it ended"} for cause in draw(ends)]},
        "ledger": {"sent": sum(topic["sent"] for topic in topics_played), "topics": topics_played},
        "recorded": {"messages": draw(st.integers(0, 2))},
        "playback": {"played_seconds": draw(seconds)},
        "machine": {"busy": draw(busy), "message": ""} | stood,
        "timings": draw(st.just({}) | st.fixed_dictionaries({"drain": seconds})),
    }


def lines_of(result: Json) -> list[tuple[int, Json]]:
    """Each line of the ledger with how many were sent."""
    return [
        (topic["sent"], line)
        for topic in result["ledger"]["topics"]
        for line in topic["subscribers"]
    ]


@many
@given(results(), modes)
def test_a_passed_case_lost_nothing_and_published_something(result: Json, mode: str) -> None:
    kept = all(line["received"] == sent and not line["dropped"] for sent, line in lines_of(result))
    ended = result["stack"]["ended"]
    spoke = result["ledger"]["sent"] > 0 and result["recorded"]["messages"] > 0
    assert (judge(result, mode=mode).outcome == "passed") == (kept and not ended and spoke)


@many
@given(results(), modes)
def test_the_gravest_reason_is_reported(result: Json, mode: str) -> None:
    found = judge(result, mode=mode)
    impossible = any(line["received"] > sent for sent, line in lines_of(result))
    lossy = any(line["received"] < sent or line["dropped"] for sent, line in lines_of(result))
    if result["stack"]["ended"]:
        assert (found.outcome, found.reason) == ("failed", result["stack"]["ended"][0]["cause"])
    elif impossible:
        assert (found.outcome, found.reason) == ("errored", "ProtocolError")
    elif lossy:
        pairs = {("failed", "MessagesLost"), ("errored", "MachineBusy")}
        assert (found.outcome, found.reason) in pairs
    elif not result["ledger"]["sent"]:
        assert (found.outcome, found.reason) == ("invalid", "NothingPlayed")
    elif not result["recorded"]["messages"]:
        assert (found.outcome, found.reason) == ("invalid", "NothingRecorded")


@many
@given(results(), modes)
def test_only_a_busy_machine_in_real_time_is_an_excuse(result: Json, mode: str) -> None:
    if mode != "realtime" or not result["machine"]["busy"]:
        assert judge(result, mode=mode).reason != "MachineBusy"


@many
@given(results(), st.sampled_from([0.01, 1.0, 100.0]))
def test_a_machine_that_did_worse_never_turns_its_fault_into_the_stack_s(
    result: Json, worse: float
) -> None:
    if judge(result).reason == "MachineBusy":
        more = copy.deepcopy(result)
        more["machine"]["late_max_seconds"] += worse
        assert judge(more).reason == "MachineBusy"


@many
@given(results(), modes)
def test_the_order_of_nodes_and_topics_decides_nothing(result: Json, mode: str) -> None:
    other = copy.deepcopy(result)
    other["ledger"]["topics"].reverse()
    for topic in other["ledger"]["topics"]:
        topic["subscribers"].reverse()
    one, two = judge(result, mode=mode), judge(other, mode=mode)
    assert (one.outcome, one.reason) == (two.outcome, two.reason)


@many
@given(results(), modes, st.data())
def test_one_loss_more_never_makes_a_pass(result: Json, mode: str, data: st.DataObject) -> None:
    worse = copy.deepcopy(result)
    whole = [(sent, line) for sent, line in lines_of(worse) if line["received"] == sent > 0]
    if whole:
        _, line = data.draw(st.sampled_from(whole))
        line["received"] -= 1
        assert judge(worse, mode=mode).outcome in ("failed", "errored")
