"""The calls about Workloads, and their fence."""

import re

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError, KubernetesApi
from bagpipe_operator.cluster.fence import Fence, FencedApi
from bagpipe_operator.jobs.kueue.queueing import KueueApi
from bagpipe_operator.jobs.kueue.workload import GROUP, PLURAL, VERSION

_PRIORITY_CLASSES = {
    GROUP: f"/apis/{GROUP}/{VERSION}/workloadpriorityclasses",
    "scheduling.k8s.io": "/apis/scheduling.k8s.io/v1/priorityclasses",
}
_NAME = re.compile(r"[a-z0-9]([-a-z0-9.]*[a-z0-9])?")


class KubernetesKueueApi(KubernetesApi):
    """KueueApi over the official asyncio client."""

    async def create_workload(self, manifest: Json) -> Json:
        return await self._create(_path(manifest["metadata"]["namespace"]), manifest)

    async def get_workload(self, namespace: str, name: str) -> Json:
        return await self._call("GET", _path(namespace, name))

    async def patch_workload_status(self, namespace: str, name: str, patch: Json) -> Json:
        return await self._patch_status(_path(namespace, name), patch)

    async def delete_workload(self, namespace: str, name: str, uid: str) -> None:
        await self._delete(_path(namespace, name), uid)

    async def get_resource_flavor(self, name: str) -> Json:
        return await self._call("GET", _named(f"/apis/{GROUP}/{VERSION}/resourceflavors", name))

    async def get_priority_class(self, group: str, name: str) -> Json:
        return await self._call("GET", _named(_PRIORITY_CLASSES[group], name))

    async def check_queues(self, namespace: str | None) -> None:
        """Raises ApiError when Kueue's CRDs are not there, or Workloads can't be listed."""
        scope = f"/namespaces/{namespace}" if namespace else ""
        await self._call("GET", f"/apis/{GROUP}/{VERSION}{scope}/{PLURAL}?limit=1")


def _path(namespace: str, name: str = "") -> str:
    below = f"/apis/{GROUP}/{VERSION}/namespaces/{namespace}/{PLURAL}"
    return f"{below}/{name}" if name else below


def _named(path: str, name: str) -> str:
    """The path of an object that a job's author has named.

    With slashes it would be that of anything the operator may read: of another tenant's, or of all.
    """
    if _NAME.fullmatch(name) is None:
        raise ApiError(404, "NotFound", f"{name!r} is no name that an object can have")
    return f"{path}/{name}"


class FencedKueueApi(FencedApi):
    """A KueueApi whose writes need an open fence. Reads harm nobody."""

    def __init__(self, api: KueueApi, fence: Fence) -> None:
        super().__init__(api, fence)
        self._queues = api

    async def create_workload(self, manifest: Json) -> Json:
        namespace = manifest["metadata"]["namespace"]
        return await self._leading(namespace, lambda: self._queues.create_workload(manifest))

    async def get_workload(self, namespace: str, name: str) -> Json:
        return await self._queues.get_workload(namespace, name)

    async def patch_workload_status(self, namespace: str, name: str, patch: Json) -> Json:
        return await self._leading(
            namespace, lambda: self._queues.patch_workload_status(namespace, name, patch)
        )

    async def delete_workload(self, namespace: str, name: str, uid: str) -> None:
        await self._leading(namespace, lambda: self._queues.delete_workload(namespace, name, uid))

    async def get_resource_flavor(self, name: str) -> Json:
        return await self._queues.get_resource_flavor(name)

    async def get_priority_class(self, group: str, name: str) -> Json:
        return await self._queues.get_priority_class(group, name)
