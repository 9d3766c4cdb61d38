"""GET /progress and /metrics of a running driver."""

import contextlib
import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest

from bagpipe.driver.progress import Progress


def serve_progress(
    progress: Progress, registry: CollectorRegistry, address: str, port: int
) -> ThreadingHTTPServer:
    """Serve until the process ends or `shutdown` is called."""

    class Handler(BaseHTTPRequestHandler):
        timeout = 5

        def do_GET(self) -> None:
            if self.path == "/progress":
                self._answer("application/json", json.dumps(progress.snapshot()).encode())
            elif self.path == "/metrics":
                self._answer(CONTENT_TYPE_LATEST, generate_latest(registry))
            else:
                self.send_error(404, "here are /progress and /metrics")

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

    server = ThreadingHTTPServer((address, port), Handler)
    threading.Thread(target=server.serve_forever, name="progress", daemon=True).start()
    return server
