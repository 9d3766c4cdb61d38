"""The connection to a pod that sends results, over a websocket whose silence a test sets."""

import time
from types import SimpleNamespace
from typing import cast

import pytest
from websocket import ABNF, WebSocket, WebSocketTimeoutException

from bagpipe.cli.pulling.entry import PullError
from bagpipe.cli.pulling.exec_stream import ExecStream


class Socket:
    """A websocket with these frames, which is silent then: a real one falls silent by chance."""

    def __init__(self, *frames: bytes) -> None:
        self.frames = list(frames)
        self.waited: list[float] = []

    def settimeout(self, seconds: float) -> None:
        self.waited.append(seconds)

    def recv_data_frame(self, control_frame: bool) -> tuple[int, SimpleNamespace]:
        assert control_frame
        if not self.frames:
            raise WebSocketTimeoutException("nothing came")
        return ABNF.OPCODE_BINARY, SimpleNamespace(data=self.frames.pop(0))


def stream(*frames: bytes, seconds: float = 1000.0) -> tuple[ExecStream, Socket]:
    socket = Socket(*frames)
    return ExecStream(cast("WebSocket", socket), 60.0, time.monotonic() + seconds), socket


def test_frames_are_taken_one_by_one_as_they_are_needed() -> None:
    found, socket = stream(b"\1ab", b"\2words", b"\1cde", b"\1f", b'\3{"status":"Success"}')
    assert found.exactly(4) == b"abcd"
    assert len(socket.frames) == 2
    assert found.exactly(2) == b"ef"
    found.end()
    assert socket.waited == [60.0] * 5


@pytest.mark.parametrize(("frames", "words"), [
    ([], "the connection to the pod broke: nothing came; pull again"),
    ([b"\2no \x1b[2J room", b'\3{"status":"Failure"}'], "can't send the results: no  [2J room"),
    ([b'\3{"status":"Failure","message":"exit status 137"}'], "the results: exit status 137"),
    ([b"\3" + b"[" * 100_000], "the connection to the pod broke;"),
])  # fmt: skip
def test_a_stream_that_ends_says_why(frames: list[bytes], words: str) -> None:
    found, _ = stream(b"\1abc", *frames)
    with pytest.raises(PullError) as broken:
        found.exactly(4)
    assert words in broken.value.message


def test_a_stream_ends_when_the_time_is_over() -> None:
    found, socket = stream(b"\1abc", seconds=0.0)
    with pytest.raises(PullError, match="the time that --timeout allows is over"):
        found.exactly(1)
    assert socket.waited == []


def test_bytes_behind_the_end_are_refused() -> None:
    found, _ = stream(b"\1abc")
    with pytest.raises(PullError, match="more than was asked for"):
        found.end()


def test_an_end_that_is_none_is_refused() -> None:
    found, _ = stream(b"\2killed", b'\3{"status":"Failure"}')
    with pytest.raises(PullError, match="can't send the results: killed"):
        found.end()
