"""GET /progress and /metrics of a running driver, and POST /job to one that takes further jobs."""

import contextlib
import json
import socket
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest

from bagpipe.driver.progress import Progress

# What a ConfigMap holds, in which the description of any other job comes.
LARGEST_JOB_BYTES = 1 << 20
_BODY_SECONDS = 5.0
# Each has a thread; the operator and who reads metrics have one each, and for a moment.
MOST_CONNECTIONS = 64


@dataclass
class Account:
    """What is served: of the job that runs, or that ran last."""

    progress: Progress
    registry: CollectorRegistry
    offered: Callable[[bytes, str], str] | None = None
    """Answers a job.json and the address that it came from, in a driver that takes further jobs."""


def serve_progress(account: Account, address: str, port: int) -> ThreadingHTTPServer:
    """Serve until the process ends or `shutdown` is called."""

    class Handler(_Handler):
        served = account

    server = _Server((address, port), Handler)
    threading.Thread(target=server.serve_forever, name="progress", daemon=True).start()
    return server


class _Server(ThreadingHTTPServer):
    """Where one connection too many comes, the first goes of the address that has most: anybody may
    open some."""

    # Who has none is not to wait for those who open theirs all at once.
    request_queue_size = 2 * MOST_CONNECTIONS

    def __init__(self, *words: Any) -> None:
        self._lock = threading.Lock()
        self._open: dict[Any, str] = {}  # their addresses
        super().__init__(*words)

    def process_request(self, request: Any, client_address: Any) -> None:
        """A connection has come."""
        with self._lock:
            self._open[request] = client_address[0]
            if len(self._open) > MOST_CONNECTIONS:
                # Its thread reads its end, and closes it. Whoever opened it may have done so.
                with contextlib.suppress(OSError):
                    self._first_of_most().shutdown(socket.SHUT_RDWR)
        super().process_request(request, client_address)

    def _first_of_most(self) -> Any:
        [(most, _)] = Counter(self._open.values()).most_common(1)
        first = next(request for request, address in self._open.items() if address == most)
        del self._open[first]
        return first

    def shutdown_request(self, request: Any) -> None:
        """A connection has been answered, or given up."""
        with self._lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Who breaks a connection off writes nothing into the log."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    served: Account
    timeout = _BODY_SECONDS

    def do_GET(self) -> None:
        if self.path == "/progress":
            self._answer("application/json", json.dumps(self.served.progress.snapshot()).encode())
        elif self.path == "/metrics":
            self._answer(CONTENT_TYPE_LATEST, generate_latest(self.served.registry))
        else:
            self.send_error(404, "here are /progress and /metrics")

    def do_POST(self) -> None:
        length = self.headers.get("Content-Length", "")
        if self.path != "/job" or self.served.offered is None:
            self.send_error(404, "this driver takes no further job")
        elif not length.isdecimal() or int(length) > LARGEST_JOB_BYTES:
            self.send_error(413, f"a job.json has at most {LARGEST_JOB_BYTES} bytes")
        elif (body := self._body(int(length))) is None:
            self.close_connection = True
        else:
            answer = self.served.offered(body, self.client_address[0])
            self._answer("text/plain", answer.encode())

    def _body(self, length: int) -> bytes | None:
        """The request's body; None where it does not come in time."""
        deadline, body = time.monotonic() + _BODY_SECONDS, b""
        with contextlib.suppress(OSError):
            while len(body) < length and time.monotonic() < deadline:
                part = self.rfile.read1(length - len(body))
                if not part:
                    break
                body += part
        return body if len(body) == length else None

    def _answer(self, kind: str, body: bytes) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        # Whoever asked may have had no patience left.
        with contextlib.suppress(ConnectionError):
            self.wfile.write(body)

    def log_message(self, *_args: Any) -> None:
        """The operator asks every other second: nothing to log."""
