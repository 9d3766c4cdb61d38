"""Whose fault a loss is."""

from typing import Any

import pytest

from bagpipe.engine.delivery import judge
from bagpipe.faults import FaultPolicy, FaultRule
from bagpipe.judgement import Allowed, Judgement

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
        (0.52, 3.2, "MessagesLost"),
        # A deadlock: in ten seconds of drain it took nothing more, and had a processor for it.
        (0.52, 10.0, "MessagesLost"),
        (4.1, 10.0, "MachineBusy"),
    ],
)
def test_a_drain_in_which_nothing_was_taken_is_to_be_explained_too(
    waited: float, drain: float, reason: str
) -> None:
    given = result(lost(10, waited)) | {"timings": {"drain": drain}}
    assert judge(given).reason == reason


def test_just_half_of_the_time_is_enough() -> None:
    given = result(lost(4, 2.0)) | {"playback": {"played_seconds": float(SENT)}}
    assert judge(given).reason == "MachineBusy"


def test_a_long_drain_may_be_another_node_s() -> None:
    right = {"node": "/computes", "received": SENT, "dropped": 0, "waited_seconds": 0.0}
    given = result(lost(4, 0.25), right) | {"timings": {"drain": 10.0}}
    assert judge(given).reason == "MachineBusy"


def test_what_is_missing_needs_an_excuse_though_nobody_dropped_it() -> None:
    assert judge(result(lost(39, 1.94) | {"dropped": 0})).reason == "MessagesLost"
    assert judge(result(lost(39, 1.96) | {"dropped": 0})).reason == "MachineBusy"


def test_what_was_dropped_needs_an_excuse_though_nothing_is_missing() -> None:
    assert judge(result(lost(10, 0.49) | {"received": SENT})).reason == "MessagesLost"
    assert judge(result(lost(10, 0.51) | {"received": SENT})).reason == "MachineBusy"


@pytest.mark.parametrize("sent", [0, 1])
def test_the_one_message_of_a_topic_takes_the_whole_playback_to_come(sent: int) -> None:
    for waited, reason in ((2.4, "MessagesLost"), (2.6, "MachineBusy")):
        given = result(lost(1, waited) | {"received": 0})
        given["ledger"]["topics"][0]["sent"] = sent
        assert judge(given).reason == reason


def test_where_nobody_looked_at_the_machine_it_is_no_excuse() -> None:
    given = result(lost(1, 3.0)) | {"machine": None}
    assert judge(given).message == (
        "/slow processed 49 of 50 messages on /scan, 1 dropped: its queue is shorter than its"
        " delay; play slower or give the node a longer queue"
    )


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
    judged = judge(result(lost(39, waited), lost(39, waited, "/second")), policy)
    assert judged.outcome == "passed"
    [allowed] = judged.allowed  # once: its sentence has them all
    assert allowed.cause == "MessagesLost"
    assert allowed.message.endswith("; also lost: /second 39 on /scan")


def test_no_node_can_have_received_more_than_was_sent() -> None:
    honest, liar = lost(3, 0.0, "/lossy"), lost(-1, 9.0, "/liar")
    assert judge(result(honest, liar | {"dropped": 0})) == Judgement(
        "errored",
        "ProtocolError",
        "/liar says that it received 51 messages on /scan, and 50 were sent: the ledger proves"
        " nothing",
    )


def left(given: dict[str, Any], *nodes: str) -> dict[str, Any]:
    """The RESULT with nodes that left the graph after the last input."""
    given["stack"]["left"] = list(nodes)
    return given


@pytest.mark.parametrize("waited", [0.0, 9.0])
def test_who_left_the_graph_without_all_of_its_messages_is_gone(waited: float) -> None:
    lossy = (lost(3, waited, "/lossy"), lost(5, waited, "/left"))
    assert judge(left(result(*lossy), "/left")) == Judgement(
        "failed",
        "NodeGone",
        "the node /left left the graph, while its process lived on, without all of its messages:"
        " /left processed 45 of 50 messages on /scan, 5 dropped; also lost: /lossy 3 on /scan",
    )


def test_who_left_with_all_of_its_messages_is_not() -> None:
    right = {"node": "/left", "received": SENT, "dropped": 0, "waited_seconds": 0.0}
    assert judge(left(result(right), "/left")) == Judgement("passed")
    assert judge(left(result(lost(3, 0.0), right), "/left")).reason == "MessagesLost"


def test_where_losses_are_allowed_a_node_may_leave_after_the_last_input() -> None:
    policy = FaultPolicy([FaultRule(cause="MessagesLost", action="allow")])
    assert judge(left(result(lost(3, 0.0)), "/slow"), policy).outcome == "passed"


def test_who_may_leave_may_not_lose() -> None:
    policy = FaultPolicy([FaultRule(cause="NodeGone", action="allow")])
    judged = judge(left(result(lost(3, 0.0)), "/slow"), policy)
    assert (judged.outcome, judged.reason) == ("failed", "MessagesLost")
    assert [allowed.cause for allowed in judged.allowed] == ["NodeGone"]


def test_of_a_ledger_that_proves_nothing_no_node_is_gone() -> None:
    given = result(lost(3, 0.0, "/left"), lost(-1, 0.0, "/liar") | {"dropped": 0})
    assert judge(left(given, "/left")).reason == "ProtocolError"


def test_on_a_calm_machine_a_loss_is_reported_with_the_queue_it_overran() -> None:
    given = result(lost(3, 0.2) | {"queue": 1}, busy=False, message="others had 2 %")
    assert judge(given) == Judgement(
        "failed",
        "MessagesLost",
        "/slow processed 47 of 50 messages on /scan, 3 dropped, 1 in its queue (others had 2 %):"
        " its queue is shorter than its delay; play slower or give the node a longer queue",
    )


def test_a_busy_machine_is_reported_with_all_losses_and_a_remedy() -> None:
    assert judge(result(lost(3, 2.0, "/first"), lost(4, 2.0, "/second"))) == Judgement(
        "errored",
        "MachineBusy",
        "/first processed 47 of 50 messages on /scan, 3 dropped, while the machine was too busy"
        " (others had 80 % of the processors; /first itself waited 2.00 s for a processor): give"
        " the stack more CPU, use fewer spark.slots or play slower; also lost: /second 4 on /scan",
    )


def test_of_many_losses_five_are_named_and_the_others_counted() -> None:
    for count, end in ((6, "/n4 1 on /scan, /n5 1 on /scan"), (8, "/n5 1 on /scan and 2 more")):
        lines = [lost(1, 0.0, f"/n{number}") for number in range(count)]
        message = judge(result(*lines)).message
        assert message.endswith(end)
        assert "; also lost: /n1 1 on /scan, /n2 1 on /scan, /n3 1 on /scan, /n4" in message


def test_nothing_that_was_played_or_recorded_is_no_pass() -> None:
    right = {"node": "/slow", "received": SENT, "dropped": 0, "waited_seconds": 0.0}
    assert judge(result(right)) == Judgement("passed")
    silent = result(right) | {"recorded": {"messages": 0}}
    assert judge(silent) == Judgement(
        "invalid", "NothingRecorded", "the stack published nothing on the recorded topics"
    )
    silent["ledger"] = {"sent": 0, "topics": []}
    assert judge(silent) == Judgement(
        "invalid", "NothingPlayed", "the fragment's window holds no message on the topics"
    )


def test_the_first_end_that_is_not_allowed_decides_and_those_before_are_reported() -> None:
    given = result(lost(1, 0.0))
    given["stack"]["ended"] = [
        {"cause": "NodeGone", "message": "/a is gone"},
        {"cause": "StackExited", "message": "roslaunch ended"},
    ]
    assert judge(given) == Judgement("failed", "NodeGone", "/a is gone")
    policy = FaultPolicy([FaultRule(cause="NodeGone", action="allow")])
    crash = Allowed("NodeGone", "/a is gone")
    assert judge(given, policy) == Judgement("failed", "StackExited", "roslaunch ended", (crash,))
