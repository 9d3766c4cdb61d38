"""The browser, a server that notes what it is asked, and where a report is written."""

import http.server
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.integration.chromium import browser

__all__ = ["browser", "listener", "page"]


@pytest.fixture
def listener() -> Iterator[tuple[str, list[str]]]:
    """A server on loopback that notes every request: its address, and the paths asked for."""
    asked: list[str] = []

    class Noting(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_arguments: object) -> None:
            """Nothing on stderr."""

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Noting)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}", asked
    server.shutdown()
    thread.join(timeout=10)


@pytest.fixture
def page(tmp_path: Path) -> Path:
    """Where a test writes its report."""
    return tmp_path / "report.html"
