"""The tests' own client asks a busy API server again, and takes no other refusal for that."""

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from embedded.api import ApiError

from tests.integration.control_plane.client import Client


class _Busy(BaseHTTPRequestHandler):
    """Answers what the server's list of statuses says next, and nothing where that is empty."""

    server: "_Server"

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        if not self.server.answers:
            self.close_connection = True
            return
        self.send_response(self.server.answers.pop(0))
        self.send_header("Retry-After", "0")
        self.send_header("Content-Length", "2")
        self.end_headers()
        self.wfile.write(b"{}")

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002  the base's name
        """Nothing: a test's output is about its client."""


class _Server(ThreadingHTTPServer):
    answers: list[int]


@pytest.fixture
def server() -> Iterator[_Server]:
    with _Server(("127.0.0.1", 0), _Busy) as running:
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        yield running
        running.shutdown()
        thread.join()


@pytest.fixture
def client(server: _Server) -> Client:
    return Client(f"http://127.0.0.1:{server.server_port}", Path("no-authority"))


def test_a_busy_server_is_asked_again_also_to_create(server: _Server, client: Client) -> None:
    server.answers = [429, 429, 201]
    assert client.create("/things", {}) == {}
    assert server.answers == []


def test_a_server_that_stays_busy_is_reported(server: _Server, client: Client) -> None:
    server.answers = [429] * 61
    with pytest.raises(ApiError, match="answered 429"):
        client.create("/things", {})
    assert server.answers == []


@pytest.mark.parametrize("status", [403, 409, 500, 503])
def test_no_other_refusal_is_asked_again(server: _Server, client: Client, status: int) -> None:
    server.answers = [status, 201]
    with pytest.raises(ApiError, match=f"answered {status}"):
        client.create("/things", {})
    assert server.answers == [201]


def test_nobody_who_answers_is_reported_at_once(client: Client, server: _Server) -> None:
    server.answers = []
    with pytest.raises(OSError, match="does not answer"):
        client.create("/things", {})
