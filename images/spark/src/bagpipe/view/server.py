"""Serves one file to viewers in a browser of this machine, in the ranges that they ask for."""

import http.server
import os
import re
import secrets
import sys
import urllib.parse
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

# One range of a size that a file may have; who asks for several, or for something else, gets all.
_RANGE = re.compile(r"bytes=(\d{1,18})?-(\d{1,18})?", re.ASCII)
_PIECE = 1 << 20
# Who waits for a slow reader waits no longer.
_SECONDS = 60


class FileServer(http.server.ThreadingHTTPServer):
    """On 127.0.0.1 at a free port: the file for whoever has its URL, and nothing else.

    Any page in the browser may ask: what it can't guess is in the URL's path.
    """

    daemon_threads = True

    def __init__(self, file: Path) -> None:
        self.file = file
        self._secret = secrets.token_urlsafe(16)
        super().__init__(("127.0.0.1", 0), _Handler)

    @property
    def url(self) -> str:
        """Where the file is."""
        name = urllib.parse.quote(self.file.name)
        return f"http://127.0.0.1:{self.server_port}/{self._secret}/{name}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Of readers that go away, as browsers do in the middle of a file, nothing is written."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


class _Handler(http.server.BaseHTTPRequestHandler):
    server: FileServer
    protocol_version = "HTTP/1.1"
    timeout = _SECONDS

    def do_OPTIONS(self) -> None:
        self._head(204, 0)

    def do_HEAD(self) -> None:
        self._answer(with_body=False)

    def do_GET(self) -> None:
        self._answer(with_body=True)

    def _answer(self, *, with_body: bool) -> None:
        if self.path.partition("?")[0] != urllib.parse.urlsplit(self.server.url).path:
            self._head(404, 0)
            return
        try:
            file = self.server.file.open("rb")
        except OSError:
            self._head(404, 0)
            return
        with file:
            size = os.fstat(file.fileno()).st_size
            asked = _range(self.headers.get("Range"), size)
            begin, end = asked or (0, size)
            if asked and begin >= end:
                self._head(416, 0, {"Content-Range": f"bytes */{size}"})
                return
            if asked:
                self._head(206, end - begin, {"Content-Range": f"bytes {begin}-{end - 1}/{size}"})
            else:
                self._head(200, size)
            if with_body:
                self._send(file, begin, end)

    def _send(self, file: BinaryIO, begin: int, end: int) -> None:
        file.seek(begin)
        while begin < end:
            piece = file.read(min(_PIECE, end - begin))
            if not piece:
                # The file was cut: what was announced can't come, and nothing else may follow.
                self.close_connection = True
                return
            self.wfile.write(piece)
            begin += len(piece)

    def _head(self, status: int, length: int, more: dict[str, str] | None = None) -> None:
        self.send_response(status)
        fixed = {
            "Accept-Ranges": "bytes",
            "Access-Control-Allow-Headers": "Range",
            "Access-Control-Allow-Origin": "*",
            "Access-Control-Expose-Headers": "Accept-Ranges, Content-Length, Content-Range",
            "Content-Length": str(length),
            "Content-Type": "application/octet-stream",
        }
        for name, value in (fixed | (more or {})).items():
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, *_args: Any) -> None:
        """A browser's many requests are no news."""


def _range(asked: str | None, size: int) -> tuple[int, int] | None:
    """First byte and the one behind the last, none of them where the range lies behind the file.

    None where all of it is to be sent.
    """
    found = _RANGE.fullmatch(asked or "")
    if found is None or found[0] == "bytes=-":
        return None
    first, last = found.groups()
    if first is None:
        return max(0, size - int(last)), size
    if last is not None and int(last) < int(first):
        return None
    return int(first), size if last is None else min(int(last) + 1, size)


def foxglove_link(url: str, time: int) -> str:
    """The page of Foxglove that shows a file at a URL from a time, in ns since 1970."""
    seconds, rest = divmod(time, 1_000_000_000)
    at = f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}.{rest:09d}Z"
    query = {"ds": "remote-file", "ds.url": url, "time": at}
    return f"https://app.foxglove.dev/~/view?{urllib.parse.urlencode(query)}"
