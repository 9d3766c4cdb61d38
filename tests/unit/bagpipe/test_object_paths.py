"""Paths that no object has: each is the fault of its own recording, and not of the driver."""

import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from bagpipe.source.planning import plan
from bagpipe.storage import Storage, StorageError
from tests.unit.bagpipe.jobs import make_spec


@pytest.mark.parametrize("path", ["a//b.bag", "a/./b.bag"])
def test_a_path_that_the_library_can_t_read_is_named_as_one(path: str) -> None:
    with pytest.raises(StorageError, match=r"can't read the path, which may have no empty part"):
        Storage({}).open(f"http://127.0.0.1:9/{path}")


def test_a_recording_of_such_a_path_is_reported_as_any_that_can_t_be_opened() -> None:
    source = {"bags": ["https://127.0.0.1:9/a//b.bag"], "topics": ["/scan"]}
    (found,) = plan(
        make_spec(source=source | {"fragment": {"length": "1s"}}), Storage({})
    ).unplanned
    assert found.bag == "https://127.0.0.1:9/a//b.bag"
    assert "no empty part" in found.message


class Emptied(BaseHTTPRequestHandler):
    """A server whose file has no bytes any more."""

    def do_GET(self) -> None:
        """As RFC 9110 has it for a range that begins behind the end."""
        self.send_response(416)
        self.send_header("Content-Range", "bytes */0")
        self.send_header("Content-Length", "0")
        self.end_headers()


def test_a_file_that_is_shorter_than_it_was_planned_is_another_file() -> None:
    with HTTPServer(("127.0.0.1", 0), Emptied) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        uri = f"http://127.0.0.1:{server.server_port}/a"
        with pytest.raises(StorageError, match=r"/a is no longer the file that was planned"):
            Storage({}).read_planned(uri, 10, "10-x")
        server.shutdown()
