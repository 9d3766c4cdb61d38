"""The server of `bagpipe open --serve`: one file in ranges, whatever is asked of it."""

import os
import socket
import threading
from collections.abc import Iterator
from contextlib import closing
from http.client import HTTPConnection, IncompleteRead
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from bagpipe.view.server import FileServer

DATA = bytes(range(200))
Answer = tuple[int, bytes, Any]


@pytest.fixture
def server(tmp_path: Path) -> Iterator[FileServer]:
    """Serves 200 bytes, beside a file that is nobody's business."""
    file = tmp_path / "a case.mcap"
    file.write_bytes(DATA)
    (tmp_path / "secret").write_text("no")
    with FileServer(file) as server:
        serving = threading.Thread(target=server.serve_forever, args=(0.05,))
        serving.start()
        try:
            yield server
        finally:
            server.shutdown()
            serving.join()


def get(server: FileServer, path: str = "", method: str = "GET", **headers: str) -> Answer:
    asked = HTTPConnection("127.0.0.1", server.server_port, timeout=10)
    with closing(asked):
        asked.request(method, path or urlsplit(server.url).path, headers=headers)
        answer = asked.getresponse()
        return answer.status, answer.read(), answer.headers


def test_a_browser_reads_the_file_and_nothing_else(server: FileServer) -> None:
    assert server.url.endswith("/a%20case.mcap")
    # Pages that were not given the URL can guess the port and the case, and not this.
    path = urlsplit(server.url).path.split("/")
    assert (len(path), len(path[1]) >= 22) == (3, True)
    assert get(server, "/a%20case.mcap")[0] == 404
    assert get(server, f"/{path[1]}/")[0] == 404
    with FileServer(server.file) as another:
        assert urlsplit(another.url).path != urlsplit(server.url).path
    status, data, headers = get(server)
    assert (status, data) == (200, DATA)
    assert headers["Access-Control-Allow-Origin"] == "*"
    for other in ("/secret", "/../secret", "/", "/%2e%2e/secret", "//secret", "/a%20case.mcap/"):
        assert get(server, other)[0] == 404
    status, data, headers = get(server, method="HEAD")
    assert (status, data, headers["Content-Length"]) == (200, b"", "200")


@pytest.mark.parametrize(
    ("asked", "begin", "end"),
    [
        ("bytes=10-19", 10, 20),
        ("bytes=190-", 190, 200),
        ("bytes=190-900", 190, 200),
        ("bytes=-50", 150, 200),
        ("bytes=-900", 0, 200),
    ],
)
def test_a_range_is_answered_by_its_bytes(
    server: FileServer, asked: str, begin: int, end: int
) -> None:
    status, data, headers = get(server, Range=asked)
    assert (status, data) == (206, DATA[begin:end])
    assert headers["Content-Range"] == f"bytes {begin}-{end - 1}/200"


# What is no range of this kind is as good as none: part of the file would be a wrong answer.
@pytest.mark.parametrize(
    "asked", ["bytes=0-9,20-29", "bytes=19-10", "bytes=-", "lines=1-2", f"bytes={'9' * 5000}-"]
)
def test_other_ranges_are_answered_by_all(server: FileServer, asked: str) -> None:
    status, data, headers = get(server, Range=asked)
    assert (status, data, headers["Content-Range"]) == (200, DATA, None)


@pytest.mark.parametrize("asked", ["bytes=200-", "bytes=-0"])
def test_a_range_behind_the_file_is_refused(server: FileServer, asked: str) -> None:
    status, data, headers = get(server, Range=asked)
    assert (status, data, headers["Content-Range"]) == (416, b"", "bytes */200")


def test_an_empty_file_is_no_error(server: FileServer) -> None:
    server.file.write_bytes(b"")
    assert get(server)[:2] == (200, b"")


def test_a_file_that_is_gone_is_not_found(server: FileServer) -> None:
    server.file.unlink()
    assert get(server)[0] == 404


def test_a_file_that_gets_shorter_ends_the_answer(server: FileServer) -> None:
    # More than the sockets between hold, so that the rest is read after the file was cut.
    os.truncate(server.file, 64 << 20)
    asked = HTTPConnection("127.0.0.1", server.server_port, timeout=10)
    with closing(asked):
        asked.request("GET", urlsplit(server.url).path)
        answer = asked.getresponse()
        os.truncate(server.file, 5)
        with pytest.raises(IncompleteRead):
            answer.read()


def test_a_reader_that_goes_away_leaves_no_traceback(
    server: FileServer, capsys: pytest.CaptureFixture[str]
) -> None:
    os.truncate(server.file, 64 << 20)
    server.daemon_threads = False  # so that closing waits for the answer's thread
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=10) as asked:
        asked.sendall(f"GET {urlsplit(server.url).path} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
        assert asked.recv(16).startswith(b"HTTP/1.1 200")
    assert get(server, Range="bytes=0-0")[0] == 206
    server.shutdown()
    server.server_close()
    assert capsys.readouterr().err == ""
