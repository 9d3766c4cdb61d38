"""Whose fault a loss is."""

from typing import Any

import pytest

from bagpipe.faults import FaultPolicy, FaultRule
from bagpipe.run.judge import judge

SENT = 50
PLAYED = 5.0


def result(*lines: dict[str, Any], busy: bool = True, **machine: Any) -> dict[str, Any]:
    """RESULT of a run of 50 messages in 5 s, in which each line of the ledger lost something."""
    return {
        "stack": {"ended": [], "stderr": []},
        "ledger": {
            "sent": SENT,
            "topics": [{"topic": "/scan", "sent": SENT, "subscribers": list(lines)}],
        },
        "recorded": {"messages": 1},
        "playback": {"played_seconds": PLAYED},
        "machine": {
            "busy": busy,
            "message": "others had 80 % of the processors",
            "stall_max_seconds": 0.0,
            "late_max_seconds": 0.0,
        }
        | machine,
    }


def lost(dropped: int, waited: float | None, node: str = "/slow") -> dict[str, Any]:
    """A node that lost some of its messages, and how long it waited for a processor."""
    received = SENT - dropped
    return {"node": node, "received": received, "dropped": dropped, "waited_seconds": waited}


@pytest.mark.parametrize(
    ("dropped", "waited", "reason"),
    [
        # 39 messages came in 3.9 s: half of that must be explained.
        (39, 0.2, "MessagesLost"),
        (39, 1.94, "MessagesLost"),
        (39, 1.96, "MachineBusy"),
        (1, 0.04, "MessagesLost"),
        (1, 0.06, "MachineBusy"),
        (39, 0.0, "MessagesLost"),
        # A process that nobody could look at, such as one that came late.
        (39, None, "MessagesLost"),
    ],
)
def test_a_busy_machine_excuses_what_it_can_have_caused(
    dropped: int, waited: float | None, reason: str
) -> None:
    assert judge(result(lost(dropped, waited))).reason == reason


@pytest.mark.parametrize(
    ("waited", "drain", "reason"),
    [
        (0.52, 0.4, "MachineBusy"),
        (0.52, 3.0, "MachineBusy"),
        # A deadlock: in ten seconds of drain it took nothing more, and had a processor for it.
        (0.52, 10.0, "MessagesLost"),
        (4.1, 10.0, "MachineBusy"),
    ],
)
def test_a_drain_in_which_nothing_was_taken_is_to_be_explained_too(
    waited: float, drain: float, reason: str
) -> None:
    told = result(lost(10, waited)) | {"timings": {"drain": drain}}
    assert judge(told).reason == reason


def test_a_long_drain_may_be_another_node_s() -> None:
    right = {"node": "/computes", "received": SENT, "dropped": 0, "waited_seconds": 0.0}
    told = result(lost(10, 0.52), right) | {"timings": {"drain": 10.0}}
    assert judge(told).reason == "MachineBusy"


def test_what_is_missing_needs_an_excuse_though_nobody_dropped_it() -> None:
    assert judge(result(lost(39, 0.0) | {"dropped": 0})).reason == "MessagesLost"


# Promise: loss-is-the-stack-s
@pytest.mark.parametrize("mode", ["max", "lockstep"])
def test_a_player_that_waits_for_the_stack_leaves_it_no_excuse(mode: str) -> None:
    assert judge(result(lost(39, 9.0)), mode=mode).reason == "MessagesLost"


def test_a_node_that_waited_on_a_calm_machine_has_no_excuse() -> None:
    assert judge(result(lost(1, 3.0), busy=False)).reason == "MessagesLost"


@pytest.mark.parametrize("figure", ["stall_max_seconds", "late_max_seconds"])
def test_a_machine_that_stood_still_is_an_excuse_too(figure: str) -> None:
    for seconds, reason in ((0.3, "MachineBusy"), (0.1, "MessagesLost")):
        stood: dict[str, Any] = {figure: seconds}
        assert judge(result(lost(4, 0.01), **stood)).reason == reason


def test_a_starved_node_does_not_hide_the_loss_of_another_one() -> None:
    judged = judge(result(lost(3, 2.0, "/starved"), lost(3, 0.01, "/lossy")))
    assert (judged.outcome, judged.reason) == ("failed", "MessagesLost")
    assert judged.message.startswith("/lossy processed 47 of 50 messages on /scan, 3 dropped")
    assert judged.message.endswith("a longer queue; also lost: /starved 3 on /scan")


def test_the_sentence_says_how_long_the_node_itself_waited() -> None:
    assert (
        "(others had 80 % of the processors; /slow itself waited 0.20 s for a processor)"
        in judge(result(lost(39, 0.2))).message
    )


@pytest.mark.parametrize("waited", [0.0, 9.0])
def test_a_loss_that_is_allowed_is_allowed_whoever_caused_it(waited: float) -> None:
    policy = FaultPolicy([FaultRule(cause="MessagesLost", action="allow")])
    judged = judge(result(lost(39, waited)), policy)
    assert judged.outcome == "passed"
    assert [each.cause for each in judged.allowed] == ["MessagesLost"]
