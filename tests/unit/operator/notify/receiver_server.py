"""A receiver of notifications: a real HTTP server, in a thread, with faults on order."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

# What a body without an end is sent in, and how much of it: no sender waits for all of it.
PIECE = b"x" * 65536
ENDLESS_BYTES = 10 << 30


@dataclass
class Received:
    """One request."""

    path: str
    headers: dict[str, str]
    body: bytes


@dataclass
class Faults:
    """What the server does with the next requests; the last of it with all that follow."""

    answers: list[str]
    received: list[Received] = field(default_factory=list)
    sent_bytes: int = 0  # of a body without an end
    closed: threading.Event = field(default_factory=threading.Event)
    over: threading.Event = field(default_factory=threading.Event)

    def next(self) -> str:
        return self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, faults: Faults) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.faults = faults


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: _Server

    def do_POST(self) -> None:
        self._answer()

    def do_GET(self) -> None:
        self._answer()

    def _answer(self) -> None:
        faults = self.server.faults
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        headers = {key.lower(): value for key, value in self.headers.items()}
        faults.received.append(Received(self.path, headers, body))
        match faults.next():
            case "silent":
                faults.over.wait()
            case "closed":
                self.close_connection = True
            case "endless":
                self._send_endlessly(faults)
            case "headers":
                self.wfile.write(b"HTTP/1.1 200 OK\r\nX-Long: " + PIECE + b"\r\n\r\n")
            case "late":
                self.send_response(200)
                self.send_header("Content-Length", "10")
                self.end_headers()
                faults.over.wait()
            case status:
                self._send_status(int(status))

    def _send_status(self, status: int) -> None:
        body = b"" if status == 204 else b"no"
        self.send_response(status)
        if body:
            self.send_header("Content-Length", str(len(body)))
        if 300 <= status < 400:
            self.send_header("Location", "/elsewhere")
        if status == 429:
            self.send_header("Retry-After", "77")
        self.end_headers()
        self.wfile.write(body)

    def _send_endlessly(self, faults: Faults) -> None:
        self.send_response(500)
        self.send_header("Content-Length", str(ENDLESS_BYTES))
        self.end_headers()
        try:
            while faults.sent_bytes < ENDLESS_BYTES:
                self.wfile.write(PIECE)
                faults.sent_bytes += len(PIECE)
        except OSError:
            self.close_connection = True
            faults.closed.set()

    def log_message(self, *_: Any) -> None:
        """Says nothing."""


@contextmanager
def receiver_server(*answers: str) -> Iterator[tuple[str, Faults]]:
    """Its address and what it got.

    An answer is a status, or one of: silent, closed, endless, headers, late (200, then silence).
    """
    faults = Faults(list(answers) or ["200"])
    server = _Server(faults)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/bagpipe", faults
    finally:
        faults.over.set()
        server.shutdown()
        server.server_close()
        thread.join()
