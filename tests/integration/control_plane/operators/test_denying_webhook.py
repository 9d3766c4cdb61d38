"""An admission webhook that denies with a status of its own choice, behind a real API server."""

import base64
import contextlib
import json
import re
import ssl
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from embedded.certificates import openssl

from tests.integration.control_plane.client import Client
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.observe import children as made_in
from tests.integration.control_plane.observe import create_jobs, expected_children, statuses
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.integration

WEBHOOKS = "/apis/admissionregistration.k8s.io/v1/validatingwebhookconfigurations"
REASONS = {404: "NotFound", 409: "AlreadyExists", 429: "TooManyRequests", 500: "InternalError"}


class _Denials(BaseHTTPRequestHandler):
    """Denies a pod with the status that its job's name has."""

    def do_POST(self) -> None:
        asked = json.loads(self.rfile.read(int(self.headers["Content-Length"])))["request"]
        code = int(re.findall(r"\d+", asked["name"])[0])
        status = {"code": code, "reason": REASONS[code], "message": "the store is away"}
        response = {"uid": asked["uid"], "allowed": False, "status": status}
        body = {"apiVersion": "admission.k8s.io/v1", "kind": "AdmissionReview"}
        text = json.dumps(body | {"response": response}).encode()
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - its own name
        """Nothing."""


@contextlib.contextmanager
def denying_webhook(admin: Client, namespace: str, folder: Path) -> Iterator[None]:
    """Each pod of a namespace is denied."""
    key, certificate = folder / "key.pem", folder / "certificate.pem"
    openssl(
        *("req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", key, "-out", certificate),
        *("-days", "2", "-subj", "/CN=127.0.0.1", "-addext", "subjectAltName=IP:127.0.0.1"),
    )
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Denials)
    server.daemon_threads = True
    server.socket = context.wrap_socket(server.socket, server_side=True)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    webhook = {
        "name": "denies.example.com",
        "clientConfig": {
            "url": f"https://127.0.0.1:{server.server_port}/",
            "caBundle": base64.b64encode(certificate.read_bytes()).decode(),
        },
        "rules": [{
            "apiGroups": [""], "apiVersions": ["v1"], "operations": ["CREATE"],
            "resources": ["pods"],
        }],
        "namespaceSelector": {"matchLabels": {"kubernetes.io/metadata.name": namespace}},
        "sideEffects": "None",
        "admissionReviewVersions": ["v1"],
    }  # fmt: skip
    admin.create(WEBHOOKS, {"metadata": {"name": namespace}, "webhooks": [webhook]})
    try:
        yield
    finally:
        admin.delete(f"{WEBHOOKS}/{namespace}")
        server.shutdown()
        server.server_close()


def test_jobs_say_what_was_denied_with_any_status_and_start_when_it_is_not(
    admin: Client, namespace: str, operator_process: StartOperator, tmp_path: Path
) -> None:
    operator_process()
    names = [f"x{code}" for code in REASONS]
    words = 'admission webhook "denies.example.com" denied the request: the store is away'

    def refused() -> int:
        found = [c for s in statuses(admin, namespace).values() for c in s.get("conditions", [])]
        named = [c for c in found if c["type"] == "Accepted" and c["reason"] == "CreationRefused"]
        return sum(words in c["message"] for c in named)

    with denying_webhook(admin, namespace, tmp_path):
        create_jobs(admin, namespace, names)
        wait_until(lambda: refused() == len(names), PATIENCE, "not all jobs say what was denied")
    wanted = expected_children(names)
    wait_until(lambda: made_in(admin, namespace) == wanted, PATIENCE, "not all jobs have drivers")
