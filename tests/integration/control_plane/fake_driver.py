"""A driver's /progress on an address of loopback, as a pod's own; its jobs are made up."""

import http.server
import random
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

PORT = 8080


@dataclass
class FakeDriver:
    """What it answers, and how often it was asked."""

    ip: str
    account: str
    asked: int = 0


@contextmanager
def fake_driver(account: str) -> Iterator[FakeDriver]:
    """Serves an account until the end of the block."""
    driver = FakeDriver("", account)

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            driver.asked += 1
            body = driver.account.encode()
            self.send_response(200)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            """Nothing: the test reports what matters."""

    server = _bound(Handler)
    driver.ip = str(server.server_address[0])
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield driver
    server.shutdown()
    thread.join(timeout=10)
    server.server_close()


def _bound(
    handler: type[http.server.BaseHTTPRequestHandler],
) -> http.server.ThreadingHTTPServer:
    """A server on the port of drivers; all of 127/8 is loopback, so several find room."""
    for _ in range(20):
        ip = f"127.{random.randint(1, 250)}.{random.randint(0, 250)}.{random.randint(1, 250)}"  # noqa: S311
        try:
            return http.server.ThreadingHTTPServer((ip, PORT), handler)
        except OSError:
            continue
    raise AssertionError(f"no address of loopback has its port {PORT} free")
