"""Recordings on a web server: read in ranges, never written; over plain HTTP, since on loopback."""

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, ClassVar

import pytest

from bagpipe.storage import Storage, StorageError
from tests.integration.storage.conftest import QUICK
from tests.integration.storage.test_contract import MIB, pattern

DATA = pattern(9 * MIB)


class WebServer(BaseHTTPRequestHandler):
    """Files by their paths, with an ETag."""

    protocol_version = "HTTP/1.1"
    files: ClassVar[dict[str, bytes]] = {"/bags/x.bag": DATA}
    knows_ranges: ClassVar[bool] = True
    tag: ClassVar[str] = '"1"'

    def do_HEAD(self) -> None:
        self.do_GET()

    def do_GET(self) -> None:
        """Answer with the range that is asked for, if any."""
        data = self.files.get(self.path)
        if data is None:
            self._answer(404, b"", {})
            return
        asked = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        if asked and self.knows_ranges:
            begin, end = int(asked[1]), min(int(asked[2]) + 1, len(data))
            headers = {"Content-Range": f"bytes {begin}-{end - 1}/{len(data)}"}
            self._answer(206, data[begin:end], headers)
        else:
            self._answer(200, data, {})

    def _answer(self, status: int, body: bytes, headers: dict[str, str]) -> None:
        self.send_response_only(status)
        for name, value in {"ETag": self.tag, "Content-Length": str(len(body)), **headers}.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(body)

    def log_message(self, *_args: Any) -> None:
        """Nobody reads it."""


@contextmanager
def web_server() -> Iterator[str]:
    """A server on a port of its own, which serves until the block ends; the URL of its bags."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), WebServer)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/bags"
    finally:
        server.shutdown()
        server.server_close()


@pytest.fixture
def web(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    monkeypatch.setattr(WebServer, "tag", '"1"')
    monkeypatch.setattr(WebServer, "knows_ranges", True)
    with web_server() as url:
        yield url


def test_a_recording_is_read_in_ranges(web: str) -> None:
    storage = Storage({}, QUICK)
    assert storage.expand(f"{web}/x.bag") == [f"{web}/x.bag"]
    assert storage.expand(f"{web}/none.bag") == []
    assert storage.size(f"{web}/x.bag") == len(DATA)
    ranges = [(8 * MIB, 100), (3, 5 * MIB)]
    pieces = storage.pieces(f"{web}/x.bag", ranges, MIB)
    assert b"".join(pieces) == DATA[8 * MIB : 8 * MIB + 100] + DATA[3 : 3 + 5 * MIB]


def test_a_recording_that_changes_is_refused(web: str, monkeypatch: pytest.MonkeyPatch) -> None:
    file = Storage({}, QUICK).open(f"{web}/x.bag")
    monkeypatch.setattr(WebServer, "tag", '"2"')
    with pytest.raises(StorageError, match="is no longer the file that was planned"):
        file.read(0, 10)


def test_a_server_that_knows_no_ranges_is_refused(
    web: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(WebServer, "knows_ranges", False)
    with pytest.raises(StorageError, match=r"x\.bag can't be read: the server gives no ranges"):
        Storage({}, QUICK).read(f"{web}/x.bag", 0, 10)


def test_a_web_server_takes_no_results_and_has_no_list(web: str) -> None:
    storage = Storage({}, QUICK)
    with pytest.raises(StorageError, match="can only be read from: name another storage"):
        storage.put_once(f"{web}/manifest.json", b"{}")
    with (
        pytest.raises(StorageError, match="can only be read from"),
        storage.create(f"{web}/y.bag"),
    ):
        pass
    with pytest.raises(StorageError, match="name each bag without wildcards"):
        storage.expand(f"{web}/*.bag")
