"""A small client of the API server for tests: dictionaries in and out, one try, a deadline."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import urllib3
from embedded.api import ApiError

Object = dict[str, Any]

# An answer is asked for once. The API server itself gives up after a minute.
TIMEOUT_SECONDS = 60.0
# An API server that has just begun answers 429 until it has read a kind's objects, each time with
# the second after which to ask again; every client of Kubernetes does.
BUSY = urllib3.Retry(
    total=None, connect=0, read=0, redirect=0, other=0, status=60, status_forcelist=[429],
    allowed_methods=None, raise_on_status=False,
)  # fmt: skip
JSON = "application/json"
MERGE_PATCH = "application/merge-patch+json"
STRATEGIC_PATCH = "application/strategic-merge-patch+json"
JOBS = "/apis/sim.bagpipe.io/v1alpha1"


def core(namespace: str, resource: str, name: str = "") -> str:
    """The path of core/v1 objects of a namespace, or of one of them."""
    return f"/api/v1/namespaces/{namespace}/{resource}" + (f"/{name}" if name else "")


def jobs(namespace: str, name: str = "") -> str:
    """The path of a namespace's SimulationJobs, or of one of them."""
    return f"{JOBS}/namespaces/{namespace}/simulationjobs" + (f"/{name}" if name else "")


@dataclass
class Client:
    """Whoever the certificate or the token speaks for. Safe to use from several threads."""

    url: str
    authority: Path
    certificate: Path | None = None
    key: Path | None = None
    token: str = ""
    _pool: urllib3.PoolManager = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._pool = urllib3.PoolManager(
            ca_certs=str(self.authority),
            cert_file=str(self.certificate) if self.certificate else None,
            key_file=str(self.key) if self.key else None,
            maxsize=8,
        )

    def with_token(self, token: str) -> "Client":
        """The same API server for somebody else."""
        return Client(self.url, self.authority, token=token)

    def call(self, method: str, path: str, body: object = None, type_: str = JSON) -> Object:
        """The decoded answer. Raises ApiError when refused, OSError when nobody answers.

        A server that has too much to do is asked again when it says, for about a minute.
        """
        headers = {"Accept": JSON, "Content-Type": type_}
        if self.token:
            headers["Authorization"] = f"Bearer {self.token}"
        try:
            answer = self._pool.request(
                method, self.url + path, json=body, headers=headers, timeout=TIMEOUT_SECONDS,
                retries=BUSY,
            )  # fmt: skip
        except urllib3.exceptions.HTTPError as error:
            raise OSError(f"{method} {path}: the API server does not answer: {error}") from error
        if answer.status >= 400:
            raise ApiError(answer.status, _message(answer.data))
        decoded: Object = answer.json()
        return decoded

    def healthy(self) -> bool:
        """Whether the API server says that it is ready; it says so in plain text."""
        try:
            answer = self._pool.request("GET", f"{self.url}/readyz", timeout=20, retries=False)
        except urllib3.exceptions.HTTPError:
            return False
        return answer.status == 200

    def get(self, path: str) -> Object:
        """One object."""
        return self.call("GET", path)

    def exists(self, path: str) -> bool:
        """Whether there is such an object."""
        try:
            self.call("GET", path)
        except ApiError as error:
            if error.status == 404:
                return False
            raise
        return True

    def items(self, path: str) -> list[Object]:
        """All objects of a collection; a selector may follow a `?`."""
        return list(self.call("GET", path)["items"])

    def create(self, path: str, body: Object) -> Object:
        """Creates an object in a collection."""
        return self.call("POST", path, body)

    def merge(self, path: str, body: Object) -> Object:
        """Merges into an object, or into its status when the path ends in /status."""
        return self.call("PATCH", path, body, MERGE_PATCH)

    def delete(self, path: str, grace_seconds: int | None = None) -> None:
        """Asks for an object's deletion; one that is gone is no error."""
        options = None if grace_seconds is None else {"gracePeriodSeconds": grace_seconds}
        try:
            self.call("DELETE", path, options)
        except ApiError as error:
            if error.status != 404:
                raise


def _message(body: bytes) -> str:
    """A Status' message, or what came in its place."""
    try:
        message = json.loads(body)["message"]
    except (ValueError, KeyError, TypeError):
        message = body.decode(errors="replace")
    return str(message)[:2000]
