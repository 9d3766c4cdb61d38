"""Schedules write nothing without leadership either."""

from typing import Protocol

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import Api
from bagpipe_operator.cluster.fence import Fence, FencedApi
from bagpipe_operator.schedules.reconcile import ScheduleApi


class WholeApi(Api, ScheduleApi, Protocol):
    """What jobs and schedules need together: KubernetesApi."""


class FencedScheduleApi(FencedApi):
    """A ScheduleApi whose writes need an open fence. Reads harm nobody."""

    def __init__(self, api: WholeApi, fence: Fence) -> None:
        super().__init__(api, fence)
        self._whole = api

    async def create_job(self, manifest: Json) -> Json:
        namespace = manifest["metadata"]["namespace"]
        return await self._leading(namespace, lambda: self._whole.create_job(manifest))

    async def try_job(self, manifest: Json) -> None:
        await self._whole.try_job(manifest)

    async def delete_job(self, namespace: str, name: str, uid: str) -> None:
        await self._leading(namespace, lambda: self._whole.delete_job(namespace, name, uid))

    async def patch_schedule_status(self, namespace: str, name: str, patch: Json) -> Json:
        return await self._leading(
            namespace, lambda: self._whole.patch_schedule_status(namespace, name, patch)
        )
