"""The few calls that the operator makes to the API server, each with a deadline.

Objects go in and out as plain dictionaries: the generated models would drop fields that they do
not know, and cost more time than the call. No call is repeated here; the queue does that.
"""

import json
from typing import Any, Protocol

import aiohttp
from kubernetes.aio.client import ApiClient
from kubernetes.aio.client.exceptions import ApiException

from bagpipe_operator import names
from bagpipe_operator.view import Json


class ApiError(Exception):
    """The API server refused a call (its HTTP status), or did not answer in time (status 0)."""

    def __init__(self, status: int, reason: str, message: str) -> None:
        super().__init__(f"{status} {reason}: {message}")
        self.status = status
        self.reason = reason
        self.message = message


class Api(Protocol):
    """What the loop needs of an API server; every method raises ApiError."""

    async def create(self, resource: str, manifest: Json) -> Json:
        """Creates a core/v1 object in its namespace."""

    async def get(self, resource: str, namespace: str, name: str) -> Json:
        """One core/v1 object."""

    async def delete_pod(self, namespace: str, name: str, uid: str) -> None:
        """Deletes a pod if it still is the one with that UID; a missing one is no error."""

    async def get_job(self, namespace: str, name: str) -> Json:
        """One SimulationJob."""

    async def patch_status(self, namespace: str, name: str, patch: Json) -> Json:
        """Merges into a SimulationJob's status; the job as it is afterwards."""


class KubernetesApi:
    """Api over the official asyncio client."""

    def __init__(self, client: ApiClient, deadline_seconds: float) -> None:
        self._client = client
        self._deadline = deadline_seconds

    async def create(self, resource: str, manifest: Json) -> Json:
        namespace = manifest["metadata"]["namespace"]
        return await self._call("POST", f"/api/v1/namespaces/{namespace}/{resource}", manifest)

    async def get(self, resource: str, namespace: str, name: str) -> Json:
        return await self._call("GET", f"/api/v1/namespaces/{namespace}/{resource}/{name}")

    async def delete_pod(self, namespace: str, name: str, uid: str) -> None:
        options = {"apiVersion": "v1", "kind": "DeleteOptions", "preconditions": {"uid": uid}}
        try:
            await self._call("DELETE", f"/api/v1/namespaces/{namespace}/pods/{name}", options)
        except ApiError as error:
            # 409: another pod has taken the name. Either way this one is gone.
            if error.status not in {404, 409}:
                raise

    async def get_job(self, namespace: str, name: str) -> Json:
        return await self._call("GET", self._job_path(namespace, name))

    async def patch_status(self, namespace: str, name: str, patch: Json) -> Json:
        return await self._call(
            "PATCH",
            f"{self._job_path(namespace, name)}/status",
            patch,
            content_type="application/merge-patch+json",
        )

    async def check_watchable(self, namespace: str | None) -> None:
        """Raises ApiError when the CRD is not there, or jobs or pods may not be listed."""
        scope = f"/namespaces/{namespace}" if namespace else ""
        await self._call("GET", f"/apis/{names.API_VERSION}{scope}/{names.PLURAL}?limit=1")
        await self._call("GET", f"/api/v1{scope}/pods?limit=1")

    @staticmethod
    def _job_path(namespace: str, name: str) -> str:
        return f"/apis/{names.API_VERSION}/namespaces/{namespace}/{names.PLURAL}/{name}"

    async def _call(
        self,
        method: str,
        path: str,
        body: Json | None = None,
        content_type: str = "application/json",
    ) -> Json:
        client: Any = self._client  # its methods carry no types
        resource, _, query = path.partition("?")
        request = await client.param_serialize(
            method=method,
            resource_path=resource,
            query_params=[tuple(query.split("=", 1))] if query else [],
            header_params={"Accept": "application/json", "Content-Type": content_type},
            body=body,
            auth_settings=["BearerToken"],
        )
        try:
            response = await client.call_api(*request, _request_timeout=self._deadline)
            text = (await response.read()).decode("utf-8", "replace")
        except ApiException as error:
            raise _refusal(error.status or 0, str(error.body or error.reason)) from error
        except (aiohttp.ClientError, TimeoutError, OSError) as error:
            what = str(error) or type(error).__name__
            raise ApiError(0, "Unreachable", f"{method} {path}: {what}") from error
        if not 200 <= response.status < 300:
            raise _refusal(response.status, text)
        answer: Json = json.loads(text)
        return answer


def _refusal(status: int, text: str) -> ApiError:
    """The API server explains itself in a Status object; proxies in front of it do not."""
    try:
        said = json.loads(text)
    except ValueError:
        return ApiError(status, "Unknown", text[:500])
    if not isinstance(said, dict):
        return ApiError(status, "Unknown", text[:500])
    return ApiError(status, str(said.get("reason") or ""), str(said.get("message") or text[:500]))
