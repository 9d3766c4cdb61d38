"""A stand-in for the agent at the other end of real FIFOs, for the faults that the real one

can't be made to show on demand. What it sends is a script; what it received is kept.
"""

import contextlib
import os
import select
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from bagpipe.wire.frames import Decoder, Encoder, Frame, FrameType
from tests.waiting import PATIENCE

# How the first frame of every session begins.
HELLO = b"BPIP\x01\x01\x00\x00"

Script = Callable[["FakeAgent"], None]

STACK: dict[str, Any] = {
    "exit_status": None, "signal": 15, "stderr": [], "stdout": [], "ended_by": "agent",
    "usage": None, "ended": [],
}  # fmt: skip
RESULT: dict[str, Any] = {
    "stack": STACK,
    "ledger": {
        "sent": 3, "lead_in": 1, "received": 3, "dropped": 0, "strength": "received",
        "topics": [{
            "topic": "/scan", "type": "std_msgs/String", "sent": 3, "lead_in": 1,
            "subscribers": [{
                "node": "/stack", "received": 3, "dropped": 0, "bytes": 48,
                "strength": "received", "queue": None, "waited_seconds": None,
            }],
        }],
    },
    "recorded": {"messages": 2, "bytes": 5, "high_water_bytes": 5, "topics": []},
    "playback": {
        "asked_rate": 1.0, "achieved_rate": 1.0, "late_max_seconds": 0.0, "played_seconds": 3.0,
    },
    "timings": dict.fromkeys(
        ("assemble", "master", "stack", "subscribe", "lead_in", "play", "drain", "stop"), 0.0
    ),
}  # fmt: skip


def make_slot(shared: Path, name: str = "0") -> Path:
    """The folder, FIFOs and lease file of a slot, as the agent makes them."""
    folder = shared / "slots" / name
    folder.mkdir(parents=True)
    os.mkfifo(folder / "to-agent")
    os.mkfifo(folder / "from-agent")
    (folder / "lease").touch()
    return folder


class FakeAgent:
    """Serves the sessions of one slot by one script each, in a thread of its own."""

    def __init__(self, folder: Path, *scripts: Script) -> None:
        self.received: list[Frame] = []
        self._outgoing = -1
        self._incoming = -1
        self._folder = folder
        self._scripts = scripts
        self._encoder = Encoder()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._thread.join(timeout=90)
        assert not self._thread.is_alive(), "the fake agent never saw its session"

    def write(self, descriptor: int, kind: FrameType, payload: bytes) -> None:
        os.write(descriptor, b"".join(self._encoder.encode(kind, payload)))

    def send(self, descriptor: int, kind: FrameType, fields: dict[str, Any]) -> None:
        os.write(descriptor, self._encoder.encode_fields(kind, fields))

    def greet(self, descriptor: int, session: str | None = None) -> None:
        own = self.received[0].fields()["session"]
        hello = {"session": session or own, "protocol": 1, "software": "fake", "pipe_bytes": 4096}
        self.send(descriptor, FrameType.HELLO, hello)

    def finish(self, descriptor: int, recorded: bytes, messages: int = 2, **changed: Any) -> None:
        """RESULT, one file, END; `changed` falsifies fields of END."""
        result = RESULT | {"recorded": RESULT["recorded"] | {"messages": messages}}
        self.send(descriptor, FrameType.RESULT, result)
        self.send(descriptor, FrameType.FILE, {"name": "case.bag", "size": len(recorded)})
        if recorded:
            self.write(descriptor, FrameType.DATA, recorded)
        end = {"files": 1, "bytes": len(recorded), "digest": self._encoder.digest}
        self.send(descriptor, FrameType.END, end | changed)

    def _serve(self) -> None:
        for script in self._scripts:
            self._encoder = Encoder()
            self.received = []
            self._outgoing = -1
            if self._incoming < 0:
                self._incoming = self._fresh()
            try:
                script(self)
                while self._incoming >= 0 and self._rest():
                    continue
                self._reopen()
                self.hang_up()
            except BaseException:
                self.vanish()
                raise
        self.vanish()

    def _rest(self) -> bytes:
        """What comes next; nothing at the end of a worker's."""
        while True:
            self._await_bytes()
            # The end of one worker was seen, and the next one has come since without a byte yet.
            with contextlib.suppress(BlockingIOError):
                return os.read(self._incoming, 65536)

    def _fresh(self) -> int:
        return os.open(self._folder / "to-agent", os.O_RDONLY | os.O_NONBLOCK)

    def _reopen(self) -> None:
        """As the real agent does: the next session's end is open before the old one is closed."""
        if self._incoming >= 0:
            old, self._incoming = self._incoming, self._fresh()
            os.close(old)

    def vanish(self) -> None:
        """Close both ends at once, as the kernel does for a killed process."""
        if self._incoming >= 0:
            os.close(self._incoming)
            self._incoming = -1
        self.hang_up()

    def hang_up(self) -> None:
        if self._outgoing >= 0:
            os.close(self._outgoing)
            self._outgoing = -1

    def read_until(self, kind: FrameType) -> None:
        """Read frames up to one of a kind, past what an earlier worker may have left behind."""
        decoder, before = Decoder(), b""
        while all(frame.type != kind for frame in self.received):
            data = self._rest()
            if data and not self.received:
                before += data
                hello = before.rfind(HELLO)
                decoder = Decoder()
                self.received += decoder.feed(before[hello:]) if hello >= 0 else []
            elif data:
                self.received += decoder.feed(data)
            elif self.received:
                return
            else:
                self._reopen()

    def _await_bytes(self) -> None:
        # Nobody may have opened the other end yet, which a read would take for its end.
        poll = select.poll()
        poll.register(self._incoming, select.POLLIN)
        assert poll.poll(PATIENCE * 1000), f"no worker within {PATIENCE:g} s"

    def open_outgoing(self) -> int:
        self._outgoing = os.open(self._folder / "from-agent", os.O_WRONLY)
        return self._outgoing


def well_behaved(
    recorded: bytes = b"bytes", before: bytes = b"", messages: int = 2, **changed: Any
) -> Script:
    """Reads everything, answers, ends; `before` is a dead session's bytes."""

    def script(agent: FakeAgent) -> None:
        agent.read_until(FrameType.END)
        outgoing = agent.open_outgoing()
        os.write(outgoing, before)
        agent.greet(outgoing)
        agent.finish(outgoing, recorded, messages, **changed)

    return script


def aborting(reason: str, message: str, stderr: list[str]) -> Script:
    """Reads HELLO only, then ABORT: the worker is still writing."""

    def script(agent: FakeAgent) -> None:
        agent.read_until(FrameType.HELLO)
        outgoing = agent.open_outgoing()
        agent.greet(outgoing)
        abort = {"reason": reason, "message": message, "exit_status": 3, "stderr": stderr}
        agent.send(outgoing, FrameType.ABORT, abort)

    return script


def dying(agent: FakeAgent) -> None:
    """Greets, sends a piece of a frame, and is gone."""
    agent.read_until(FrameType.HELLO)
    outgoing = agent.open_outgoing()
    agent.greet(outgoing)
    os.write(outgoing, b"BPIP\x01")
    agent.vanish()
