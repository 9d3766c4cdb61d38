"""A fake for faults: an HTTP proxy before a real server, which breaks chosen answers.

What it passes on is unchanged, so that signatures hold.
"""

import http.client
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, ClassVar

SLOW_DOWN = (
    b"<Error><Code>SlowDown</Code><Message>Please reduce your request rate.</Message></Error>"
)

# Longer than anybody waits: the end of the proxy ends a stall.
STALL_SECONDS = 600


@dataclass(frozen=True)
class Fault:
    """What becomes of one answer: `status` replaces it; else it ends after `keep` body bytes.

    `how` is "close" (the connection ends in good order), "reset" (it does not) or "stall"
    (nothing comes any more).
    """

    status: int = 0
    keep: int = 0
    how: str = "close"


@dataclass(frozen=True)
class Seen:
    """A request that came, and the status that its client got (0: no head of an answer)."""

    method: str
    path: str
    range: str
    status: int


@dataclass
class FaultyProxy:
    """The next requests of a method meet the faults of that method, one each, in order."""

    upstream_port: int
    port: int = 0
    faults: dict[str, list[Fault]] = field(default_factory=dict)
    seen: list[Seen] = field(default_factory=list)
    # Ends all stalled answers.
    over: threading.Event = field(default_factory=threading.Event)
    lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def next_fault(self, method: str) -> Fault | None:
        with self.lock:
            waiting = self.faults.get(method, [])
            return waiting.pop(0) if waiting else None

    def ranges(self) -> list[str]:
        """The ranges of the GETs so far, in the order in which their answers ended."""
        with self.lock:
            return [one.range for one in self.seen if one.method == "GET" and one.range]

    def count(self, method: str) -> int:
        with self.lock:
            return sum(one.method == method for one in self.seen)


@contextmanager
def faulty_proxy(upstream_port: int) -> Iterator[FaultyProxy]:
    """A proxy on a port of its own, which serves until the block ends."""
    proxy = FaultyProxy(upstream_port)
    server = ThreadingHTTPServer(("127.0.0.1", 0), type("Handler", (_Handler,), {"proxy": proxy}))
    server.daemon_threads = True
    proxy.port = int(server.server_address[1])
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    try:
        yield proxy
    finally:
        proxy.over.set()
        server.shutdown()
        server.server_close()


class _Handler(BaseHTTPRequestHandler):
    proxy: ClassVar[FaultyProxy]
    protocol_version = "HTTP/1.1"
    timeout = 60

    def do_GET(self) -> None:
        """Pass on any method."""
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        fault = self.proxy.next_fault(self.command)
        if fault and fault.status:
            self._answer(fault.status, {}, SLOW_DOWN, None)
            return
        try:
            status, headers, answer = self._upstream(body)
        except OSError:
            self._note(0)
            self.close_connection = True
            return
        self._answer(status, headers, answer, fault)

    def do_PUT(self) -> None:
        self.do_GET()

    def do_POST(self) -> None:
        self.do_GET()

    def do_DELETE(self) -> None:
        self.do_GET()

    def do_HEAD(self) -> None:
        self.do_GET()

    def _upstream(self, body: bytes) -> tuple[int, dict[str, str], bytes]:
        upstream = http.client.HTTPConnection("127.0.0.1", self.proxy.upstream_port, timeout=30)
        upstream.putrequest(self.command, self.path, skip_host=True, skip_accept_encoding=True)
        for name, value in self.headers.items():
            upstream.putheader(name, value)
        upstream.endheaders(body)
        answer = upstream.getresponse()
        try:
            return answer.status, dict(answer.headers.items()), answer.read()
        finally:
            upstream.close()

    def _answer(
        self, status: int, headers: dict[str, str], body: bytes, fault: Fault | None
    ) -> None:
        self._note(status)
        if fault and not fault.keep and fault.how == "reset":
            self._reset()
            return
        self.send_response_only(status)
        for name, value in headers.items():
            if name.lower() not in {"connection", "transfer-encoding", "content-length"}:
                self.send_header(name, value)
        length = headers.get("Content-Length") if self.command == "HEAD" else None
        self.send_header("Content-Length", length or str(len(body)))
        self.end_headers()
        try:
            self.wfile.write(body[: fault.keep] if fault else body)
            self.wfile.flush()
        except OSError:
            self.close_connection = True
        if fault:
            self._break(fault)

    def _break(self, fault: Fault) -> None:
        self.close_connection = True
        if fault.how == "stall":
            self.proxy.over.wait(STALL_SECONDS)
        elif fault.how == "reset":
            self._reset()

    def _reset(self) -> None:
        self.close_connection = True
        linger = struct.pack("ii", 1, 0)
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)

    def _note(self, status: int) -> None:
        with self.proxy.lock:
            asked = self.headers.get("Range", "").removeprefix("bytes=")
            self.proxy.seen.append(Seen(self.command, self.path, asked, status))

    def log_message(self, *_args: Any) -> None:
        """The requests are noted for the test."""
