"""What the kubelets say of a job's pods: which images they resolved, and on which nodes.

A tag may have moved between two executors of one job, so all pods are looked at, now and then and
at the end. The driver may list the pods of its namespace, which Spark needs too; nodes it may not.
"""

import logging
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode

from bagpipe.driver.api_server import ACCOUNT, API_SERVER, get_json
from bagpipe.driver.beside import Beside

_UID_LABEL = "sim.bagpipe.io/job-uid"
_LOOK_SECONDS = 60.0
_PAGE = 500
_MOST_IMAGES = 100

Json = Mapping[str, Any]

log = logging.getLogger(__name__)


class Seen:
    """The images and nodes of all pods that were seen. Not for several threads at once."""

    def __init__(self) -> None:
        self._pods: dict[tuple[str, str, str], set[str]] = {}
        self.nodes: dict[str, str] = {}

    def add(self, pods: Iterable[Json]) -> None:
        """Pods as the API server sends them; one that is seen again adds what is new of it."""
        for pod in pods:
            name, spec, status = pod["metadata"]["name"], pod["spec"], pod.get("status") or {}
            if node := spec.get("nodeName"):
                self.nodes[name] = node
            asked = {
                container["name"]: container.get("image") or ""
                for kind in ("initContainers", "containers")
                for container in spec.get(kind) or []
            }
            for kind in ("initContainerStatuses", "containerStatuses"):
                for container in status.get(kind) or []:
                    if digest := container.get("imageID"):
                        key = (container["name"], asked.get(container["name"], ""), _plain(digest))
                        self._pods.setdefault(key, set()).add(name)

    def images(self) -> list[dict[str, Any]]:
        """For each container what was asked for, what it was resolved to, and in how many pods."""
        return [
            {"container": container, "image": image, "digest": digest, "pods": len(pods)}
            for (container, image, digest), pods in sorted(self._pods.items())
        ][:_MOST_IMAGES]


def _plain(digest: str) -> str:
    return digest.removeprefix("docker-pullable://").removeprefix("docker://")


def pods_of(
    namespace: str, uid: str, server: str = API_SERVER, account: Path = ACCOUNT
) -> list[Json]:
    """All pods of a job. Raises OSError, and ValueError for an answer that is none."""
    found: list[Json] = []
    more = ""
    while True:
        asked = {"labelSelector": f"{_UID_LABEL}={uid}", "limit": _PAGE, "continue": more}
        path = f"/api/v1/namespaces/{quote(namespace)}/pods?{urlencode(asked)}"
        page = get_json(path, server, account)
        found += page["items"]
        more = (page.get("metadata") or {}).get("continue") or ""
        if not more:
            return found


class Looking(Beside):
    """Looks at the pods while a block runs, and once more at its end: `with Looking(...)`."""

    def __init__(self, look: Callable[[], Iterable[Json]], seen: Seen) -> None:
        super().__init__("pods", _LOOK_SECONDS, self._once)
        self._pods = look
        self._seen = seen

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        self._once()

    def _once(self) -> bool:
        try:
            self._seen.add(self._pods())
        except (OSError, ValueError, KeyError, TypeError) as error:
            # A digest less is no reason to end a job.
            log.warning("the job's pods can't be looked at: %s", error)
        return True
