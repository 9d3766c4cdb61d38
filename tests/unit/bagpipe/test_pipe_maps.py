"""What the agent sends is compared with its model: a damaged map is a sentence with the field."""

import copy
import io
import time
from collections import deque
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from bagpipe.engine.exec.result import RESULT as PROGRAM_RESULT
from bagpipe.engine.replay_result import RESULT as REPLAY_RESULT
from bagpipe.wire.frames import Decoder, FrameType
from bagpipe.wire.maps.result import RESULT as ANY_RESULT
from bagpipe.wire.maps.session import FileToAgent, WorkerHello
from bagpipe.wire.maps.shape import MapError, check
from bagpipe.wire.maps.turns import Step
from bagpipe.wire.session import (
    Answer,
    InputFile,
    SessionError,
    _outgoing,
    _turns,
    engine_result,
    run_session,
)
from bagpipe.wire.slot import lease, open_ends
from docs.site import pipe_maps
from tests.unit.bagpipe.fake_agent import RESULT, STACK, FakeAgent, Script, make_slot

PROGRAM: dict[str, Any] = {
    "engine": "exec", "stack": STACK, "files": [{"name": "a", "size": 1}], "bytes_in": 0,
    "bytes_out": 1, "records_in": 0, "records_out": 1, "program": {"image": b"png"},
    "timings": {"stack": 0.0, "run": 0.0, "stop": 0.0},
}  # fmt: skip
END: dict[str, Any] = {"files": 0, "bytes": 0}


def changed(result: dict[str, Any], place: str, *value: Any) -> dict[str, Any]:
    """A copy with a value in a place, such as ledger.topics.0.sent, or without the place."""
    copied = copy.deepcopy(result)
    inner: Any = copied
    *parents, last = [int(part) if part.isdigit() else part for part in place.split(".")]
    for part in parents:
        inner = inner[part]
    if value:
        inner[last] = value[0]
    else:
        del inner[last]
    return copied


def test_what_the_agent_sends_is_accepted_with_fields_of_a_later_version() -> None:
    check("RESULT", REPLAY_RESULT, changed(RESULT, "ledger.topics.0.later", 7))
    check("RESULT", PROGRAM_RESULT, PROGRAM | {"later": None})
    # Of an engine of another's making the worker needs no more than this.
    check("RESULT", ANY_RESULT, {"stack": STACK})


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ("ledger", (), "RESULT from the agent has no ledger: use one release's images together"),
        ("ledger.topics.0.sent", (), "has no ledger.topics[0].sent: use"),
        ("ledger.topics.0.subscribers.0.queue", (), "has no ledger.topics[0].subscribers[0].queue"),
        ("ledger.topics.0.sent", ("3",), "has '3' as ledger.topics[0].sent (Input should be"),
        ("ledger.sent", (-1,), "has -1 as ledger.sent"),
        ("ledger.sent", (True,), "has True as ledger.sent"),
        ("ledger.sent", (2.0,), "has 2.0 as ledger.sent"),
        ("ledger", (["x" * 200],), f"has ['{'x' * 58}... as ledger ("),
        ("stack.ended_by", ("nobody",), "has 'nobody' as stack.ended_by (Input should be 'agent'"),
        ("timings.play", (float("nan"),), "has nan as timings.play"),
        ("playback.played_seconds", (-0.5,), "has -0.5 as playback.played_seconds"),
        ("machine", (None,), "has None as machine"),
    ],
)
def test_the_sentence_names_the_field(place: str, value: tuple[Any, ...], words: str) -> None:
    with pytest.raises(MapError) as refused:
        check("RESULT", REPLAY_RESULT, changed(RESULT, place, *value))
    assert words in str(refused.value)


@pytest.mark.parametrize(("model", "other"), [(REPLAY_RESULT, PROGRAM), (PROGRAM_RESULT, RESULT)])
def test_a_result_of_another_engine_is_refused(
    model: TypeAdapter[Any], other: dict[str, Any]
) -> None:
    with pytest.raises(SessionError, match=r"has no (ledger|engine): use one release's") as refused:
        engine_result(Answer(result=other), model)
    assert refused.value.reason == "ProtocolError"
    assert engine_result(Answer(result=RESULT), REPLAY_RESULT) is RESULT


def sending(*frames: tuple[FrameType, dict[str, Any]], greet: bool = True) -> Script:
    """An agent that sends these maps, whatever it receives."""

    def script(agent: FakeAgent) -> None:
        agent.read_until(FrameType.HELLO)
        outgoing = agent.open_outgoing()
        if greet:
            agent.greet(outgoing)
        own = {"session": agent.received[0].fields()["session"]}
        for kind, fields in frames:
            agent.send(outgoing, kind, fields if greet else own | fields)

    return script


@pytest.mark.parametrize(
    ("script", "words"),
    [
        (sending((FrameType.RESULT, changed(RESULT, "stack.stderr"))), "RESULT.*no stack.stderr"),
        (sending((FrameType.RESULT, {})), "RESULT.*has no stack"),
        (sending((FrameType.FILE, {"size": 3})), "FILE.*has no name"),
        (sending((FrameType.FILE, {"name": "a", "size": "3"})), "FILE.*has '3' as size"),
        (sending((FrameType.RESULT, RESULT), (FrameType.END, END)), "END.*has no digest"),
        (sending((FrameType.ABORT, {"reason": "Internal"})), "ABORT.*has no message"),
        (sending((FrameType.ABORT, {"reason": 7, "message": ""})), "ABORT.*has 7 as reason"),
        (sending((FrameType.HELLO, {"protocol": 1}), greet=False), "HELLO.*has no software"),
        (sending((FrameType.HELLO, {"protocol": 2}), greet=False), "protocol 2, this worker 1"),
    ],
)
def test_a_damaged_map_ends_the_session_with_a_sentence(
    tmp_path: Path, script: Script, words: str
) -> None:
    folder, deadline = make_slot(tmp_path), time.monotonic() + 60
    with (
        FakeAgent(folder, script),
        pytest.raises(SessionError, match=words) as failed,
        lease(tmp_path, deadline) as slot,
        open_ends(slot, deadline) as ends,
    ):
        run_session(ends, {"id": "a"}, [], io.BytesIO(), deadline)
    assert failed.value.reason == "ProtocolError"


def written(*pieces: bytes | memoryview | None) -> list[tuple[FrameType, dict[str, Any]]]:
    frames = Decoder().feed(b"".join(piece or b"" for piece in pieces))
    return [(each.type, each.fields()) for each in frames if each.type is not FrameType.DATA]


def test_what_the_worker_sends_is_what_the_models_say() -> None:
    file = InputFile("a.bag", 2, [(0, 7, 2)], lambda: iter([b"ab"]))
    hello, head, _ = written(*_outgoing("0" * 32, {"id": "a"}, [file]))
    TypeAdapter(WorkerHello).validate_python(hello[1])
    TypeAdapter(FileToAgent).validate_python(head[1])

    class Twice:
        def step(self, answer: dict[str, Any], /) -> dict[str, Any] | None:
            number = answer["number"]
            data = b"x" * (600_000 * number)
            return {"time": number, "messages": [[0, data]]} if number < 3 else None

    answers = deque({"number": number} for number in range(4))
    _, *steps, _ = written(*_turns("0" * 32, {"id": "a"}, Twice(), answers))
    assert [step["messages"][0][1] for _, step in steps] == [b"", 600_000, 1_200_000]
    for kind, step in steps:
        assert kind is FrameType.STEP
        TypeAdapter(Step).validate_python(step)


def test_the_schemas_and_the_tables_are_up_to_date() -> None:
    assert pipe_maps.main(["--check"]) == 0


def test_a_mark_without_an_end_is_refused() -> None:
    page = pipe_maps.PAGE.read_text()
    with pytest.raises(SystemExit, match="put the marks"):
        pipe_maps.with_tables(page.replace(pipe_maps.END, "", 1), {})
    with pytest.raises(SystemExit, match="put the marks"):
        pipe_maps.with_tables("no table", {})
