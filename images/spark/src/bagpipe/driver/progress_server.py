"""GET /progress and /metrics of a running driver."""

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from bagpipe.driver.progress import Progress


class _ProgressCollector(Collector):
    """The job's counts as gauges; they describe one process, so they carry no job label."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def collect(self) -> list[GaugeMetricFamily]:
        snapshot = self._progress.snapshot()
        cases = GaugeMetricFamily("bagpipe_cases", "Cases by state", labels=["state"])
        for state, count in snapshot["cases"].items():
            cases.add_metric([state], count)
        ledger = GaugeMetricFamily("bagpipe_ledger_messages", "Messages", labels=["counted"])
        for counted, count in snapshot["ledger"].items():
            ledger.add_metric([counted], count)
        return [cases, ledger]


def serve_progress(progress: Progress, address: str, port: int) -> ThreadingHTTPServer:
    """Serve until the process ends or `shutdown` is called."""
    registry = CollectorRegistry()
    registry.register(_ProgressCollector(progress))

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
            self.wfile.write(body)

        def log_message(self, *_args: Any) -> None:
            """The operator asks every other second: nothing to log."""

    server = ThreadingHTTPServer((address, port), Handler)
    threading.Thread(target=server.serve_forever, name="progress", daemon=True).start()
    return server
