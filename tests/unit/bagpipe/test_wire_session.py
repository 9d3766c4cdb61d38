"""A session over real FIFOs: what arrives, and what the worker reads when the agent fails."""

import fcntl
import io
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bagpipe.wire import session as session_module
from bagpipe.wire.frames import Encoder, FrameType
from bagpipe.wire.session import Answer, InputFile, SessionError, run_session
from bagpipe.wire.slot import SlotUnavailableError, lease, open_ends
from tests.unit.bagpipe.fake_agent import (
    RESULT,
    FakeAgent,
    Script,
    aborting,
    dying,
    make_slot,
    well_behaved,
)

MEBIBYTE = 1 << 20


def big_file(pieces: int = 3) -> InputFile:
    def produce() -> Iterator[bytes]:
        for number in range(pieces):
            yield bytes([number]) * MEBIBYTE

    return InputFile("pvc://x/a.bag", pieces * MEBIBYTE, [(0, 100, pieces * MEBIBYTE)], produce)


def run(shared: Path, sink: io.BytesIO, file: InputFile, seconds: float = 60.0) -> Answer:
    deadline = time.monotonic() + seconds
    with lease(shared, deadline) as slot, open_ends(slot, deadline) as ends:
        return run_session(ends, {"id": "case"}, [file], sink, deadline)


def test_everything_arrives_in_both_directions(tmp_path: Path) -> None:
    folder = make_slot(tmp_path)
    sink = io.BytesIO()
    with FakeAgent(folder, well_behaved(b"recorded")) as agent:
        answer = run(tmp_path, sink, big_file())
    assert sink.getvalue() == b"recorded"
    assert answer.result == RESULT
    assert (answer.files, answer.bytes, answer.hello["pipe_bytes"]) == (1, 8, 4096)
    data = [frame.payload for frame in agent.received if frame.type is FrameType.DATA]
    assert b"".join(data) == b"".join(big_file().pieces())
    end = agent.received[-1].fields()
    assert (end["files"], end["bytes"]) == (1, 3 * MEBIBYTE)


def failure(shared: Path, script: Script) -> SessionError:
    with FakeAgent(make_slot(shared), script), pytest.raises(SessionError) as failed:
        run(shared, io.BytesIO(), big_file())
    return failed.value


def test_an_abort_while_the_worker_writes_keeps_its_reason_and_stderr(tmp_path: Path) -> None:
    failed = failure(tmp_path, aborting("StackExited", "it ended", ["hm", "boom"]))
    assert (failed.reason, str(failed), failed.stderr) == (
        "StackExited",
        "it ended (exit status 3); its last line on stderr: boom",
        ["hm", "boom"],
    )


def test_a_dead_agent_is_named(tmp_path: Path) -> None:
    failed = failure(tmp_path, dying)
    assert failed.reason == "AgentDied"
    assert "5 of a cut frame" in str(failed)


def test_what_a_dead_session_left_in_the_pipe_is_thrown_away(tmp_path: Path) -> None:
    folder = make_slot(tmp_path)
    with FakeAgent(folder, well_behaved(b"ours", before=leftovers())):
        sink = io.BytesIO()
        answer = run(tmp_path, sink, big_file())
    assert (sink.getvalue(), answer.hello["pipe_bytes"]) == (b"ours", 4096)


def leftovers() -> bytes:
    """Another session's HELLO, a frame of it, and one that is cut."""
    stale = Encoder()
    hello = stale.encode_fields(FrameType.HELLO, {"session": "0" * 32, "protocol": 1})
    whole = b"".join(stale.encode(FrameType.DATA, b"old bytes"))
    return hello + whole + b"".join(stale.encode(FrameType.DATA, bytes(5000)))[:100]


def test_an_earlier_sessions_end_is_not_taken_for_ours(tmp_path: Path) -> None:
    folder = make_slot(tmp_path)
    earlier = os.open(folder / "from-agent", os.O_RDWR)
    closing = threading.Timer(0.2, os.close, [earlier])
    with FakeAgent(folder, well_behaved(b"ours")):
        closing.start()
        sink = io.BytesIO()
        run(tmp_path, sink, big_file())
    assert sink.getvalue() == b"ours"


def test_an_agent_that_never_says_hello_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session_module, "GREETING_SECONDS", 0.3)
    folder = make_slot(tmp_path)
    silent = os.open(folder / "to-agent", os.O_RDWR)
    try:
        with pytest.raises(SessionError, match="did not answer") as failed:
            run(tmp_path, io.BytesIO(), big_file())
        assert failed.value.reason == "AgentDied"
    finally:
        os.close(silent)


def test_an_agent_that_dies_after_the_last_byte_is_noticed(tmp_path: Path) -> None:
    folder = make_slot(tmp_path)

    def vanishing(agent: FakeAgent) -> None:
        agent.read_until(FrameType.END)
        agent.vanish()

    begun = time.monotonic()
    with FakeAgent(folder, vanishing), pytest.raises(SessionError) as failed:
        run(tmp_path, io.BytesIO(), big_file())
    assert failed.value.reason == "AgentDied"
    assert time.monotonic() - begun < 30


@pytest.mark.parametrize("changed", [{"digest": 1}, {"bytes": 4}, {"files": 2}])
def test_an_end_that_does_not_match_is_refused(tmp_path: Path, changed: dict[str, Any]) -> None:
    failed = failure(tmp_path, well_behaved(**changed))
    assert failed.reason == "ProtocolError"
    assert "END says" in str(failed)


def test_an_agent_that_never_answers_ends_at_the_deadline(tmp_path: Path) -> None:
    folder = make_slot(tmp_path)
    silent = os.open(folder / "to-agent", os.O_RDWR)
    try:
        begun = time.monotonic()
        with pytest.raises(SessionError) as failed:
            run(tmp_path, io.BytesIO(), big_file(), seconds=0.3)
        assert failed.value.reason == "AgentDied"
        assert time.monotonic() - begun < 30
    finally:
        os.close(silent)


def test_no_agent_behind_the_fifo_is_reported_at_the_deadline(tmp_path: Path) -> None:
    make_slot(tmp_path)
    with pytest.raises(SlotUnavailableError, match="no agent reads"):
        run(tmp_path, io.BytesIO(), big_file(), seconds=0.2)


def test_a_leased_slot_is_passed_over_and_freed_after_use(tmp_path: Path) -> None:
    first, second = make_slot(tmp_path, "0"), make_slot(tmp_path, "1")
    deadline = time.monotonic() + 60
    with lease(tmp_path, deadline) as one, lease(tmp_path, deadline) as two:
        assert [one.folder, two.folder] == [first, second]
        with (
            pytest.raises(SlotUnavailableError, match="all are leased"),
            lease(tmp_path, time.monotonic() + 0.1),
        ):
            pass
    with lease(tmp_path, deadline) as again:
        assert again.folder == first


def test_the_pipe_is_widened_as_far_as_the_node_allows(tmp_path: Path) -> None:
    folder = make_slot(tmp_path)
    agent = os.open(folder / "to-agent", os.O_RDWR)
    try:
        deadline = time.monotonic() + 60
        with lease(tmp_path, deadline) as slot, open_ends(slot, deadline) as ends:
            assert ends.pipe_bytes == fcntl.fcntl(ends.write, 1032) == 256 * 1024
    finally:
        os.close(agent)
