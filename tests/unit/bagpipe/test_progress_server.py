"""The driver's port, which anybody may reach: connections of a stranger and of the operator."""

import json
import socket
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from http.server import ThreadingHTTPServer

import pytest
from prometheus_client import CollectorRegistry

from bagpipe.driver import progress_server
from bagpipe.driver.progress import Progress
from bagpipe.driver.progress_server import MOST_CONNECTIONS, Account, serve_progress

STRANGER = "127.0.0.2"
_SECONDS = 60.0


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[ThreadingHTTPServer]:
    # What is given up here is given up for its number, however busy the machine is.
    monkeypatch.setattr(progress_server, "_BODY_SECONDS", _SECONDS)
    monkeypatch.setattr(progress_server._Handler, "timeout", _SECONDS)
    account = Account(Progress("pvc://results/r"), CollectorRegistry())
    account.offered = lambda body, sender: f"{len(body)} from {sender}"
    serving = serve_progress(account, "127.0.0.1", 0)
    yield serving
    serving.shutdown()
    serving.server_close()


def connected(server: ThreadingHTTPServer, sender: str, words: bytes) -> socket.socket:
    address = ("127.0.0.1", server.server_address[1])
    opened = socket.create_connection(address, _SECONDS, (sender, 0))
    opened.sendall(words)
    return opened


def test_who_opens_connections_without_end_takes_no_threads_and_holds_up_nobody(
    server: ThreadingHTTPServer, capfd: pytest.CaptureFixture[str]
) -> None:
    before = threading.active_count()
    with ExitStack() as opened:
        offer = b"POST /job HTTP/1.1\r\nContent-Length: 3\r\n\r\nab"
        operator = opened.enter_context(connected(server, "127.0.0.1", offer))
        for _ in range(3 * MOST_CONNECTIONS):
            begun = connected(server, STRANGER, b"GET /progress HTTP/1.1\r\nX: ")
            opened.enter_context(begun)
        operator.sendall(b"c")
        assert operator.makefile("rb").read().endswith(b"3 from 127.0.0.1")
        url = f"http://127.0.0.1:{server.server_address[1]}/progress"
        with urllib.request.urlopen(url, timeout=_SECONDS) as answer:
            assert json.load(answer)["phase"] == "Planning"
        deadline = time.monotonic() + _SECONDS
        while threading.active_count() > before + MOST_CONNECTIONS:
            assert time.monotonic() < deadline
            time.sleep(0.01)
    assert capfd.readouterr().err == ""
