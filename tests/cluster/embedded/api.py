"""A very small client of the API server: what the cluster's own start needs, and no more."""

from __future__ import annotations

import http.client
import json
import ssl
from typing import Any

from .places import API_PORT, FIRST, PKI

Object = dict[str, Any]
TIMEOUT_SECONDS = 10.0


class ApiError(Exception):
    """The API server refused: `status` is the HTTP status."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(f"the API server answered {status}: {message}")
        self.status = status


class Api:
    """One kept-alive connection, as the cluster's administrator."""

    def __init__(self) -> None:
        context = ssl.create_default_context(cafile=str(PKI / "ca.crt"))
        context.load_cert_chain(PKI / "admin.crt", PKI / "admin.key")
        self._connection = http.client.HTTPSConnection(
            FIRST.address, API_PORT, timeout=TIMEOUT_SECONDS, context=context
        )

    def call(self, method: str, path: str, body: Object | None = None) -> Object:
        """The decoded answer. Raises ApiError, or OSError when nobody answers."""
        status, text = self.raw(method, path, body)
        if status >= 400:
            raise ApiError(status, text[:500])
        answer: Object = json.loads(text)
        return answer

    def raw(self, method: str, path: str, body: Object | None = None) -> tuple[int, str]:
        headers = {"Accept": "application/json"}
        content = None
        if body is not None:
            content = json.dumps(body)
            patch = "application/strategic-merge-patch+json"
            headers["Content-Type"] = patch if method == "PATCH" else "application/json"
        try:
            self._connection.request(method, path, content, headers)
            response = self._connection.getresponse()
            return response.status, response.read().decode(errors="replace")
        except (OSError, http.client.HTTPException) as error:
            # A connection that failed once can't be used again; the next call opens a new one.
            self._connection.close()
            raise OSError(f"the API server does not answer: {error}") from error

    def create(self, path: str, body: Object) -> None:
        """Create an object; one that exists already is left as it is."""
        try:
            self.call("POST", path, body)
        except ApiError as error:
            if error.status != http.client.CONFLICT:
                raise

    def healthy(self, path: str = "/readyz") -> bool:
        try:
            return self.raw("GET", path)[0] == http.client.OK
        except OSError:
            return False

    def node_ready(self, name: str) -> bool:
        try:
            conditions = self.call("GET", f"/api/v1/nodes/{name}")["status"]["conditions"]
        except (OSError, ApiError, KeyError):
            return False
        return any(c["type"] == "Ready" and c["status"] == "True" for c in conditions)
