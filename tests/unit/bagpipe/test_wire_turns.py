"""A simulator's turns over real FIFOs: what goes out when, and what a broken agent brings."""

import io
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bagpipe.wire.frames import Decoder, Frame, FrameType
from bagpipe.wire.session import Answer, SessionError, run_session, run_turns
from bagpipe.wire.slot import lease, open_ends
from tests.unit.bagpipe.fake_agent import FakeAgent, Script, make_slot


class Counting:
    """Answers each turn with its number, `turns` times; keeps what it received."""

    def __init__(self, turns: int) -> None:
        self.turns = turns
        self.received: list[dict[str, Any]] = []

    def step(self, answer: dict[str, Any], /) -> dict[str, Any] | None:
        self.received.append(answer)
        number = len(self.received)
        return {"time": number, "messages": [[0, b"x" * number]]} if number <= self.turns else None


def run(shared: Path, partner: Any, sink: io.BytesIO) -> Answer:
    deadline = time.monotonic() + 60
    with lease(shared, deadline) as slot, open_ends(slot, deadline) as ends:
        return run_turns(ends, {"id": "drive"}, partner, sink, deadline)


def taking_turns(
    end: Callable[[FakeAgent, int], None], frames_read: list[Frame], most: int = 1000
) -> Script:
    """Greets, answers every STEP, and does `end` after END or the `most`-th STEP."""

    def script(agent: FakeAgent) -> None:
        agent.read_until(FrameType.HELLO)
        outgoing = agent.open_outgoing()
        agent.greet(outgoing)
        decoder = Decoder()
        decoder._sequence = 1
        for number in range(most):
            messages = [["/cmd", "geometry_msgs/Twist", bytes([number])]] if number else []
            agent.send(outgoing, FrameType.ANSWER, {"messages": messages})
            frames: list[Frame] = []
            while not frames:
                data = agent._rest()
                if not data:
                    return
                frames = list(decoder.feed(data))
            frames_read.extend(frames)
            if frames[-1].type is FrameType.END:
                break
        end(agent, outgoing)

    return script


def test_each_answer_brings_one_step_until_the_drive_is_over(tmp_path: Path) -> None:
    frames_read: list[Frame] = []
    partner, sink = Counting(5), io.BytesIO()
    finish = taking_turns(lambda agent, out: agent.finish(out, b"bag"), frames_read)
    with FakeAgent(make_slot(tmp_path), finish):
        answer = run(tmp_path, partner, sink)
    assert answer.finished
    assert sink.getvalue() == b"bag"
    assert [frame.type.name for frame in frames_read] == ["STEP"] * 5 + ["END"]
    assert [frame.fields()["time"] for frame in frames_read[:5]] == [1, 2, 3, 4, 5]
    assert frames_read[4].fields()["messages"] == [[0, b"xxxxx"]]
    assert [answer["messages"] for answer in partner.received[:3]] == [
        [], [["/cmd", "geometry_msgs/Twist", b"\x01"]], [["/cmd", "geometry_msgs/Twist", b"\x02"]],
    ]  # fmt: skip
    assert frames_read[5].fields().keys() == {"files", "bytes", "digest"}


class Heavy(Counting):
    """Says more in its second turn than a frame holds."""

    def step(self, answer: dict[str, Any], /) -> dict[str, Any] | None:
        step = super().step(answer)
        if step is not None and step["time"] == 2:
            step["messages"] = [[1, b"a" * 2_500_000], [0, b""], [1, b"bc"]]
        return step


def test_messages_that_fit_no_frame_go_out_before_their_step(tmp_path: Path) -> None:
    frames_read: list[Frame] = []

    def script(agent: FakeAgent) -> None:
        agent.read_until(FrameType.HELLO)
        outgoing = agent.open_outgoing()
        agent.greet(outgoing)
        decoder = Decoder()
        decoder._sequence = 1
        agent.send(outgoing, FrameType.ANSWER, {"messages": []})
        while data := agent._rest():
            for frame in decoder.feed(data):
                frames_read.append(frame)
                if frame.type is FrameType.STEP:
                    agent.send(outgoing, FrameType.ANSWER, {"messages": []})
                if frame.type is FrameType.END:
                    agent.finish(outgoing, b"")
                    return

    with FakeAgent(make_slot(tmp_path), script):
        assert run(tmp_path, Heavy(3), io.BytesIO()).finished
    kinds = [frame.type.name for frame in frames_read]
    assert kinds == ["STEP", "DATA", "DATA", "DATA", "DATA", "STEP", "STEP", "END"]
    data = b"".join(frame.payload for frame in frames_read if frame.type is FrameType.DATA)
    assert data == b"a" * 2_500_000 + b"bc"
    assert frames_read[5].fields() == {"time": 2, "messages": [[1, 2_500_000], [0, 0], [1, 2]]}
    assert frames_read[6].fields()["messages"] == [[0, b"xxx"]]
    assert frames_read[7].fields()["bytes"] == 2_500_002


def test_an_agent_that_dies_between_two_turns_is_named(tmp_path: Path) -> None:
    gone = taking_turns(lambda agent, _: agent.vanish(), [], most=3)
    with FakeAgent(make_slot(tmp_path), gone), pytest.raises(SessionError) as failed:
        run(tmp_path, Counting(100), io.BytesIO())
    assert failed.value.reason == "AgentDied"


def test_a_drive_that_is_given_up_keeps_its_reason(tmp_path: Path) -> None:
    class Fussy(Counting):
        def step(self, answer: dict[str, Any], /) -> dict[str, Any] | None:
            if len(self.received) == 2:
                raise SessionError("BadControl", "no such pedal")
            return super().step(answer)

    never = taking_turns(lambda agent, out: agent.finish(out, b""), [])
    with FakeAgent(make_slot(tmp_path), never), pytest.raises(SessionError, match="no such pedal"):
        run(tmp_path, Fussy(100), io.BytesIO())


def test_an_answer_without_a_simulator_is_a_protocol_error(tmp_path: Path) -> None:
    def script(agent: FakeAgent) -> None:
        agent.read_until(FrameType.HELLO)
        outgoing = agent.open_outgoing()
        agent.greet(outgoing)
        agent.send(outgoing, FrameType.ANSWER, {"messages": []})

    with FakeAgent(make_slot(tmp_path), script), pytest.raises(SessionError) as failed:
        deadline = time.monotonic() + 60
        with lease(tmp_path, deadline) as slot, open_ends(slot, deadline) as ends:
            run_session(ends, {"id": "case"}, [], io.BytesIO(), deadline)
    assert failed.value.reason == "ProtocolError"
    assert "ANSWER came, and no simulator has its turn" in str(failed.value)
