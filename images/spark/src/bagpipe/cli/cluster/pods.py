"""Pods that a verb makes itself: created, looked at, reached and removed, with rights asked first.

What a job's own pods wrote is in pod_logs.py.
"""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

import websocket
from kubernetes.stream import ws_client

from bagpipe.cli.cluster.api import LABEL_ROLE, Cluster, text_of
from bagpipe.cli.cluster.faults import Asked, ClusterError, refused
from bagpipe.cli.cluster.state import Json

_MOST_BYTES = 16 << 20
_MOST_EVENTS = 50
_MOST_DRIVERS = 50
_GRACE_SECONDS = 1
# Of it every API server passes frames on to the kubelet as they are.
_PROTOCOL = ws_client.V4_CHANNEL_PROTOCOL


@dataclass(frozen=True)
class Pods:
    """The pods of a cluster's namespace. Every method raises ClusterError."""

    cluster: Cluster

    def create(self, manifest: Json) -> Json:
        """The pod as the API server took it."""
        core, name = self.cluster.core, str(manifest["metadata"]["name"])
        return self._called("create", name, lambda: core.create_namespaced_pod(
            self.cluster.namespace,
            manifest,  # type: ignore[arg-type]  # it takes its JSON as well
            field_manager="bagpipe", **self._raw,
        ))  # fmt: skip

    def get(self, name: str) -> Json:
        """A pod."""
        core = self.cluster.core
        return self._called("get", name, lambda: core.read_namespaced_pod(
            name, self.cluster.namespace, **self._raw,
        ))  # fmt: skip

    def remove(self, name: str) -> None:
        """Has a pod ended and removed; one that is gone is none to remove."""
        core = self.cluster.core
        try:
            self._called("delete", name, lambda: core.delete_namespaced_pod(
                name, self.cluster.namespace, grace_period_seconds=_GRACE_SECONDS, **self._raw,
            ))  # fmt: skip
        except ClusterError as error:
            if error.status != 404:
                raise

    def drivers(self) -> list[Json]:
        """Drivers of jobs of the namespace, the newest first."""
        core = self.cluster.core
        found = self._called("list", "", lambda: core.list_namespaced_pod(
            self.cluster.namespace, label_selector=f"{LABEL_ROLE}=driver", limit=_MOST_DRIVERS,
            **self._raw,
        ))  # fmt: skip
        return sorted(
            found["items"], key=lambda pod: str(pod["metadata"]["creationTimestamp"]), reverse=True
        )

    def warning(self, name: str) -> str:
        """What the latest Warning about a pod says; empty without one, or without the right."""
        core = self.cluster.core
        try:
            found = self._called("list", "", lambda: core.list_namespaced_event(
                self.cluster.namespace, limit=_MOST_EVENTS,
                field_selector=f"involvedObject.name={name},type=Warning", **self._raw,
            ), "events")  # fmt: skip
        except ClusterError:
            return ""
        events = sorted(found["items"], key=_when)
        return f"{events[-1].get('reason')}: {events[-1].get('message')}" if events else ""

    def refused_rights(self, rights: Iterable[tuple[str, str]]) -> list[str]:
        """Of (verb, resource) those that the user does not have, as `verb resource`.

        Where the API server answers no such question, none: it will refuse the act itself.
        """
        return [f"{verb} {resource}" for verb, resource in rights if not self._may(verb, resource)]

    def exec(self, name: str, container: str, command: list[str]) -> websocket.WebSocket:
        """A websocket to a command's stdin, stdout and stderr, each a channel of it."""
        client = self.cluster.core.api_client
        where = f"/api/v1/namespaces/{quote(self.cluster.namespace)}/pods/{quote(name)}/exec"
        query = [("container", container), *(("command", word) for word in command)]
        query += [(stream, "true") for stream in ("stdin", "stdout", "stderr")]
        # It takes a dictionary or pairs, whatever its annotation says.
        _, url, headers, *_ = client.param_serialize(
            "GET", where, query_params=query, auth_settings=["BearerToken"]
        )
        headers = {key.lower(): value for key, value in headers.items()}
        return self.cluster.asked(
            "get", "pods/exec", name, lambda: self._connected(url, headers, name)
        )

    def _connected(self, url: str, headers: dict[str, str], name: str) -> websocket.WebSocket:
        before = websocket.getdefaulttimeout()
        # It can't be given to the client's own function, which knows proxies and certificates.
        websocket.setdefaulttimeout(self.cluster.seconds)
        try:
            found: websocket.WebSocket = ws_client.create_websocket(  # type: ignore[no-untyped-call]
                self.cluster.core.api_client.configuration,
                ws_client.get_websocket_url(url),  # type: ignore[no-untyped-call]
                headers | {"sec-websocket-protocol": _PROTOCOL},
            )
            return found
        except websocket.WebSocketBadStatusException as error:
            body = (error.resp_body or b"").decode(errors="replace")
            asked = Asked("get", "pods/exec", name, self.cluster.namespace, self.cluster.context)
            raise refused(error.status_code, str(error), body, asked) from error
        except websocket.WebSocketException as error:
            raise OSError(str(error)) from error
        finally:
            websocket.setdefaulttimeout(before)

    def _may(self, verb: str, resource: str) -> bool:
        kind, _, below = resource.partition("/")
        asked = {"verb": verb, "resource": kind, "subresource": below}
        review = {"spec": {"resourceAttributes": asked | {"namespace": self.cluster.namespace}}}
        client = self.cluster.core.api_client
        request = client.param_serialize(
            "POST", "/apis/authorization.k8s.io/v1/selfsubjectaccessreviews", body=review,
            header_params={"Content-Type": "application/json", "Accept": "application/json"},
            auth_settings=["BearerToken"],
        )  # fmt: skip
        try:
            answer = self._called(
                "create", "",
                lambda: client.call_api(*request, _request_timeout=self.cluster.seconds).response,
                "selfsubjectaccessreviews",
            )  # fmt: skip
        except ClusterError as error:
            if error.status in (401, 0) or error.passing:
                raise
            return True
        return bool((answer.get("status") or {}).get("allowed"))

    @property
    def _raw(self) -> dict[str, Any]:
        return {"_request_timeout": self.cluster.seconds, "_preload_content": False}

    def _called(self, verb: str, name: str, call: Any, resource: str = "pods") -> Json:
        text = self.cluster.asked(verb, resource, name, lambda: text_of(call(), _MOST_BYTES))
        try:
            found: Json = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ClusterError(f"the API server answered with what is no JSON: {error}") from error
        return found


def _when(event: Json) -> str:
    return str(event.get("lastTimestamp") or event.get("eventTime") or "")
