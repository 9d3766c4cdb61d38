"""`bagpipe doctor` against what answers as no API server does, or never."""

import json
import socket
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from tests.unit.cli.test_doctor import doctor


def kubeconfig(server: str) -> dict[str, Any]:
    return {
        "apiVersion": "v1",
        "kind": "Config",
        "current-context": "lab",
        "clusters": [{"name": "lab", "cluster": {"server": server}}],
        "contexts": [{"name": "lab", "context": {"cluster": "lab"}}],
    }


class _LoginPage(BaseHTTPRequestHandler):
    """Answers each question alike, as a proxy does of one who has not logged in."""

    def do_GET(self) -> None:
        body = b'{"status": "login required"}'
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Nothing."""


def test_what_is_no_api_server_is_named_and_ends_with_2(tmp_path: Path) -> None:
    with ThreadingHTTPServer(("127.0.0.1", 0), _LoginPage) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        config = kubeconfig(f"http://127.0.0.1:{server.server_port}")
        (tmp_path / "config").write_text(json.dumps(config))
        done = doctor("--output", "json", KUBECONFIG=str(tmp_path / "config"))
        server.shutdown()
    assert done.exit_code == 2, done.output
    found = [each for each in json.loads(done.stdout) if each["part"] == "cluster"]
    assert [each["found"] for each in found] == ["what answers for context lab is no API server"]


@pytest.mark.timeout(60)
def test_a_cluster_that_never_answers_ends_with_2(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        server = f"http://127.0.0.1:{silent.getsockname()[1]}"
        (tmp_path / "config").write_text(json.dumps(kubeconfig(server)))
        words = ("--timeout", "300ms", "--output", "json")
        done = doctor(*words, KUBECONFIG=str(tmp_path / "config"))
    assert done.exit_code == 2, done.output
    found = [each for each in json.loads(done.stdout) if each["part"] == "cluster"]
    assert [each["state"] for each in found] == ["unknown"]
    assert "context lab does not answer" in found[0]["found"]
