"""The API server, by the Kubernetes project's own client; every call has a deadline.

Importing this takes half a second: verbs that need no cluster must not wait for it (see place.py).
"""

import difflib
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import urllib3
import yaml
from kubernetes import client, config, watch
from kubernetes.client.exceptions import ApiException

from bagpipe.cli.cluster.faults import Asked, ClusterError, no_job, no_namespace, refused
from bagpipe.cli.cluster.faults import unreachable as not_reached
from bagpipe.cli.cluster.state import Json

GROUP, VERSION, PLURAL = "sim.bagpipe.io", "v1alpha1", "simulationjobs"
LABEL_UID, LABEL_ROLE = f"{GROUP}/job-uid", f"{GROUP}/role"

_SECONDS = 15.0
# Bookmarks come about once a minute; a connection that says nothing for longer is dead.
_SILENT_SECONDS = 90.0
_MOST_NAMES = 500
_MOST_PODS = 200
_MOST_BYTES = 64 << 20
_PIECE_BYTES = 64 << 10
_IN_CLUSTER = Path("/var/run/secrets/kubernetes.io/serviceaccount/namespace")

T = TypeVar("T")


@dataclass(frozen=True)
class Cluster:
    """One namespace of a cluster, as the user of a context may see it."""

    namespace: str
    context: str
    custom: client.CustomObjectsApi
    core: client.CoreV1Api
    seconds: float = _SECONDS

    def job(self, name: str) -> Json:
        """A job. Raises ClusterError; for one that is not there with the names like it."""
        try:
            return self._called("get", name, lambda: self.custom.get_namespaced_custom_object(
                GROUP, VERSION, self.namespace, PLURAL, name, _request_timeout=self.seconds,
            ))  # fmt: skip
        except ClusterError as error:
            if error.status != 404 or "knows no SimulationJobs" in error.message:
                raise
            raise ClusterError(self._why_missing(name), status=404) from error

    def names(self, most: int = _MOST_NAMES) -> list[str]:
        """The names of the namespace's jobs, the first `most`. Raises ClusterError."""
        found = self._called("list", "", lambda: self.custom.list_namespaced_custom_object(
            GROUP, VERSION, self.namespace, PLURAL, limit=most, _request_timeout=self.seconds,
        ))  # fmt: skip
        return sorted(str(job["metadata"]["name"]) for job in found["items"])

    def create(self, job: Json, dry_run: bool = False) -> Json:
        """The job as the API server took it; fields that it does not know are refused.

        Raises ClusterError with each fault in a sentence of its own.
        """
        metadata = job["metadata"]
        name = str(metadata.get("name") or f"{metadata.get('generateName', '')}*")
        return self._called("create", name, lambda: self.custom.create_namespaced_custom_object(
            GROUP, VERSION, self.namespace, PLURAL, job, dry_run="All" if dry_run else None,
            field_manager="bagpipe", field_validation="Strict", _request_timeout=self.seconds,
        ))  # fmt: skip

    def delete(self, name: str) -> None:
        """Delete a job; one that is not there is deleted. Raises ClusterError."""
        try:
            self._called("delete", name, lambda: self.custom.delete_namespaced_custom_object(
                GROUP, VERSION, self.namespace, PLURAL, name, _request_timeout=self.seconds,
            ))  # fmt: skip
        except ClusterError as error:
            if error.status != 404:
                raise

    def changes(self, name: str, version: str, seconds: float) -> Iterator[tuple[str, Json]]:
        """(`ADDED`, `MODIFIED` or `DELETED`, job) since a version, for at most `seconds`.

        Raises ClusterError; a watch that the server ends is no error.
        """
        whole = max(1, round(seconds))
        events = watch.Watch().stream(  # type: ignore[no-untyped-call]
            self.custom.list_namespaced_custom_object,
            GROUP, VERSION, self.namespace, PLURAL,
            field_selector=f"metadata.name={name}",
            resource_version=version,
            allow_watch_bookmarks=True,
            timeout_seconds=whole,
            _request_timeout=(self.seconds, min(_SILENT_SECONDS, whole + 2.0)),
        )  # fmt: skip
        while True:
            event = self.asked("watch", PLURAL, name, lambda: next(events, None))
            if event is None:
                return
            if event["type"] != "BOOKMARK":
                yield event["type"], event["raw_object"]

    def pods(self, uid: str, role: str) -> list[Json]:
        """The pods of a job in one role, driver or executor. Raises ClusterError."""
        text = self.asked("list", "pods", "", lambda: text_of(self.core.list_namespaced_pod(
            self.namespace, label_selector=f"{LABEL_UID}={uid},{LABEL_ROLE}={role}",
            limit=_MOST_PODS, _request_timeout=self.seconds, _preload_content=False,
        ), _MOST_BYTES))  # fmt: skip
        pods: list[Json] = json.loads(text)["items"]
        return pods

    def log(self, pod: str, container: str, lines: int, most_bytes: int) -> str:
        """The last lines of a container, of them the last `most_bytes`. Raises ClusterError."""
        return self.asked("get", "pods/log", pod, lambda: text_of(
            self.core.read_namespaced_pod_log(
                pod, self.namespace, container=container, tail_lines=lines,
                _request_timeout=self.seconds, _preload_content=False,
            ), most_bytes,
        ))  # fmt: skip

    def asked(self, verb: str, resource: str, name: str, call: Callable[[], T]) -> T:
        """What a call of the client returns. Raises ClusterError, which names all of these."""
        asked = self._about(verb, resource, name)
        try:
            return call()
        except ApiException as error:
            body = error.body if isinstance(error.body, str) else ""
            raise refused(error.status or 0, str(error.reason), body, asked) from error
        except (urllib3.exceptions.HTTPError, OSError) as error:
            raise not_reached(error, asked) from error

    def _why_missing(self, name: str) -> str:
        asked = self._about("get", PLURAL, name)
        try:
            self.asked("get", "namespaces", self.namespace, lambda: self.core.read_namespace(
                self.namespace, _request_timeout=self.seconds,
            ))  # fmt: skip
        except ClusterError as error:
            if error.status == 404:
                return no_namespace(asked)
        try:
            names = self.names()
        except ClusterError:
            names = []
        return no_job(asked, difflib.get_close_matches(name, names), len(names))

    def _called(self, verb: str, name: str, call: Callable[[], Any]) -> Json:
        found: Json = self.asked(verb, PLURAL, name, call)
        return found

    def _about(self, verb: str, resource: str, name: str) -> Asked:
        return Asked(verb, resource, name, self.namespace, self.context)


def text_of(answer: Any, most_bytes: int) -> str:
    """The end of a body that the client has not read. Raises ApiException for an error."""
    kept = bytearray()
    for piece in answer.stream(_PIECE_BYTES):
        kept += piece
        del kept[:-most_bytes]
    text = kept.decode(errors="replace")
    if not 200 <= answer.status <= 299:
        raise ApiException(status=answer.status, reason=answer.reason, body=text)
    return text


def connect(context: str | None, namespace: str | None, seconds: float = _SECONDS) -> Cluster:
    """The cluster of a kubeconfig's context, or the one in which this process is a pod.

    Raises ClusterError when there is no configuration, or none that can be used.
    """
    settings = client.Configuration()
    settings.retries = 0  # a verb fails soon, with a sentence; the watch has retries of its own
    where = os.environ.get("KUBECONFIG") or str(Path("~/.kube/config").expanduser())
    files = [Path(part).expanduser() for part in where.split(os.pathsep) if part]
    try:
        if not any(file.is_file() for file in files):
            return _in_cluster(settings, files, namespace, seconds)
        chosen = _context(where, context)
        config.load_kube_config(  # type: ignore[no-untyped-call]
            where, chosen["name"], client_configuration=settings
        )
    except (config.ConfigException, OSError, yaml.YAMLError, KeyError, TypeError) as error:
        raise ClusterError(
            f"the kubeconfig {where} can't be used: {error}. `kubectl config view` shows what is"
            " in it"
        ) from error
    place = namespace or chosen["context"].get("namespace") or "default"
    return _cluster(settings, place, chosen["name"], seconds)


def _context(where: str, name: str | None) -> Json:
    contexts, current = config.list_kube_config_contexts(where)  # type: ignore[no-untyped-call]
    if name is None:
        return dict(current)
    for found in contexts:
        if found["name"] == name:
            return dict(found)
    there = ", ".join(sorted(str(found["name"]) for found in contexts)) or "none"
    raise ClusterError(f"there is no context {name} in {where}; there are: {there}")


def _in_cluster(
    settings: client.Configuration, files: list[Path], namespace: str | None, seconds: float
) -> Cluster:
    if not _IN_CLUSTER.is_file():
        named = " or ".join(str(file) for file in files)
        raise ClusterError(
            f"there is no kubeconfig: {named} does not exist. Set KUBECONFIG to the file that"
            " your cluster's administrator or provider gave you"
        )
    config.load_incluster_config(  # type: ignore[no-untyped-call]
        client_configuration=settings
    )
    place = namespace or _IN_CLUSTER.read_text().strip()
    return _cluster(settings, place, "in-cluster", seconds)


def _cluster(
    settings: client.Configuration, namespace: str, context: str, seconds: float
) -> Cluster:
    api = client.ApiClient(settings)
    return Cluster(namespace, context, client.CustomObjectsApi(api), client.CoreV1Api(api), seconds)
