"""GET /progress and /metrics of a running driver, and POST /job to one that takes further jobs."""

import contextlib
import json
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest

from bagpipe.driver.progress import Progress

# What a ConfigMap holds, in which the description of any other job comes.
LARGEST_JOB_BYTES = 1 << 20
_BODY_SECONDS = 5.0


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

    server = ThreadingHTTPServer((address, port), Handler)
    threading.Thread(target=server.serve_forever, name="progress", daemon=True).start()
    return server


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
