"""The few calls that the operator makes to the API server, each with a deadline.

Objects go in and out as plain dictionaries: the generated models would drop fields that they do
not know, and cost more time than the call. No call is repeated here; the queue does that.
"""

import asyncio
import re
import time
from collections.abc import AsyncIterator, Callable
from typing import Any, Protocol

import aiohttp
from kubernetes.aio.client import ApiClient
from kubernetes.aio.client.exceptions import ApiException
from kubernetes.aio.config import ConfigException

from bagpipe_operator.api import names
from bagpipe_operator.api.nesting import loads
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.large_objects import PAGE, read_answer, trimmed

# The kubelet joins what it repeats, so a pod that starts has about a dozen.
MOST_EVENTS = 100
# Anybody with rights in a namespace may write others, of 1.4 MB each: a page takes seven.
EVENTS_IN_PAGE = 5
TIMEOUT = "Timeout"
# By the API server, before the webhook's own words; and by a policy of an administrator's.
_DENIED = re.compile(
    r'^admission webhook "[^"]*" denied the request'
    r"|ValidatingAdmissionPolicy '[^']*' with binding '[^']*' denied request"
)
# How much earlier the API server gives up than we do: its answer has to arrive.
ANSWER_SECONDS = 0.5
# One in good health may need as long for a pod.
SHORTEST_CREATION_SECONDS = 1.0
# What a message is known by stands at its beginning; a megabyte of a tenant's words may follow.
_LONGEST_REFUSAL = 4096
_JSON = "application/json"
_METADATA_ALONE = "application/json;as=PartialObjectMetadataList;g=meta.k8s.io;v=v1"


class ApiError(Exception):
    """The API server refused a call (its HTTP status), or did not answer in time (status 0)."""

    def __init__(self, status: int, reason: str, message: str) -> None:
        super().__init__(f"{status} {reason}: {message}")
        self.status = status
        self.reason = reason
        self.message = message

    def is_gone(self, name: str) -> bool:
        """Whether there is no object of that name; any other 404, as of a proxy or of a CRD that is
        not served for a moment, says nothing of it."""
        missing = self.status == 404 and self.reason == "NotFound" and not self.admission_denies
        return missing and f'"{name}"' in self.message

    @property
    def name_is_taken(self) -> bool:
        """Whether what was to be created is there; any other conflict may pass."""
        taken = self.status == 409 and self.reason == "AlreadyExists"
        return taken and not self.admission_denies

    def is_anothers(self, uid: str) -> bool:
        """Whether the object is not the one with that UID; any other conflict, as by a webhook's
        denial, says nothing of it."""
        another = (f"the UID in the precondition ({uid})", f"UID in precondition: {uid},")
        return (
            self.status == 409
            and self.message.startswith("Operation cannot be fulfilled on ")
            and any(words in self.message for words in another)
        )

    @property
    def quota_is_full(self) -> bool:
        """Whether the namespace's quota has no room at present."""
        return self.status == 403 and "exceeded quota" in self.message

    @property
    def namespace_ends(self) -> bool:
        """Whether nothing is created any more because the namespace is being deleted."""
        return self.status == 403 and "being terminated" in self.message

    @property
    def webhook_is_down(self) -> bool:
        """Whether an admission webhook does not answer the API server; that may last."""
        return self.status == 500 and "failed calling webhook" in self.message

    @property
    def admission_denies(self) -> bool:
        """Whether an admission webhook or policy answered with a denial; it chooses the status."""
        return _DENIED.search(self.message) is not None

    @property
    def refuses_for_good(self) -> bool:
        """Whether only a person can have it take what was asked: it is invalid, or forbidden."""
        return self.status in {400, 403, 413, 422}

    @property
    def refuses(self) -> bool:
        """Whether the API server has refused what was asked, and would so again; not a conflict,
        nor what it had no time or no turn for."""
        return self.refuses_for_good or self.status == 500 or self.admission_denies

    @property
    def timed_out(self) -> bool:
        """Whether the API server gave no answer in time; it may have done what was asked."""
        late = self.status == 504 and not self.admission_denies
        return late or (self.status == 0 and self.reason == TIMEOUT)

    @property
    def webhook_is_awaited(self) -> bool:
        """Whether a webhook gives no answer, as far as can be known: it is down, or hangs."""
        return self.webhook_is_down or self.timed_out

    @property
    def webhook_is_not_tried(self) -> bool:
        """Whether a dry run would call a webhook with side effects: it says nothing of the real."""
        return self.status == 400 and "does not support dry run" in self.message


class Objects(Protocol):
    """Where a core/v1 object is looked up."""

    async def get(self, resource: str, namespace: str, name: str) -> Json:
        """One core/v1 object; raises ApiError."""


class Api(Objects, Protocol):
    """What the loop needs of an API server; every method raises ApiError."""

    async def create(self, resource: str, manifest: Json) -> Json:
        """Creates a core/v1 object in its namespace."""

    async def try_create(self, resource: str, manifest: Json) -> None:
        """Has a core/v1 object judged as if it were created; nothing is kept."""

    async def events_of(self, namespace: str, uid: str) -> list[Json]:
        """At most MOST_EVENTS Events about the object with that UID."""

    async def delete_pod(
        self, namespace: str, name: str, uid: str, grace_seconds: int | None = None
    ) -> bool:
        """Deletes a pod if it still is the one with that UID; says whether it was there.

        It has its own grace period unless another is given.
        """

    async def get_job(self, namespace: str, name: str) -> Json:
        """One SimulationJob."""

    async def get_schedule(self, namespace: str, name: str) -> Json:
        """One SimulationSchedule."""

    async def list_jobs(self, namespace: str, label: str, most: int | None = None) -> list[Json]:
        """The SimulationJobs with a label, written `key=value`, without their specs.

        No more than `most` are asked for, if that is given.
        """

    async def delete_unchanged_job(self, namespace: str, name: str, uid: str, version: str) -> None:
        """Deletes a SimulationJob if it still is the one with that UID, and unchanged.

        Raises ApiError with status 404 or 409 where it is not.
        """

    async def patch_status(
        self, namespace: str, name: str, patch: Json, urgent: bool = True
    ) -> Json:
        """Merges into a SimulationJob's status; the job as it is afterwards.

        What is not urgent leaves others a turn where few writes are made at once.
        """


async def get_if_there(api: Objects, resource: str, namespace: str, name: str) -> Json | None:
    """One core/v1 object, or None where there is none of that name."""
    try:
        return await api.get(resource, namespace, name)
    except ApiError as error:
        if not error.is_gone(name):
            raise
        return None


class KubernetesApi:
    """Api over the official asyncio client."""

    def __init__(
        self,
        client: ApiClient,
        deadline_seconds: float,
        counted: Callable[[str, int, float], None] = lambda _method, _status, _seconds: None,
        writes_for: Callable[[], float] = lambda: float("inf"),
    ) -> None:
        """`counted` is called with each call; `writes_for` says after how many seconds a write that
        begins now is given up."""
        self._client = client
        self._deadline = deadline_seconds
        self._counted = counted
        self._writes_for = writes_for

    async def create(self, resource: str, manifest: Json) -> Json:
        namespace = manifest["metadata"]["namespace"]
        return await self._create(f"/api/v1/namespaces/{namespace}/{resource}", manifest)

    async def try_create(self, resource: str, manifest: Json) -> None:
        namespace = manifest["metadata"]["namespace"]
        await self._try(f"/api/v1/namespaces/{namespace}/{resource}", manifest)

    async def get(self, resource: str, namespace: str, name: str) -> Json:
        return await self._call("GET", f"/api/v1/namespaces/{namespace}/{resource}/{name}")

    async def events_of(self, namespace: str, uid: str) -> list[Json]:
        query = f"fieldSelector=involvedObject.uid={uid}&limit={EVENTS_IN_PAGE}"
        path = f"/api/v1/namespaces/{namespace}/events?{query}"
        found: list[Json] = []
        try:
            async with asyncio.timeout(self._deadline):  # as long as one call, whatever is there
                async for event in self._listed(path):
                    found.append(event)
                    if len(found) == MOST_EVENTS:
                        break
        except TimeoutError:
            raise ApiError(0, TIMEOUT, f"GET {path}: too many pages to be read in time.") from None
        return found

    async def delete_pod(
        self, namespace: str, name: str, uid: str, grace_seconds: int | None = None
    ) -> bool:
        grace = {} if grace_seconds is None else {"gracePeriodSeconds": grace_seconds}
        return await self._delete(f"/api/v1/namespaces/{namespace}/pods/{name}", uid, grace)

    async def get_job(self, namespace: str, name: str) -> Json:
        return await self._call("GET", self._job_path(namespace, name))

    async def delete_unchanged_job(self, namespace: str, name: str, uid: str, version: str) -> None:
        options = {
            "apiVersion": "v1",
            "kind": "DeleteOptions",
            "preconditions": {"uid": uid, "resourceVersion": version},
            # Its pods and ConfigMaps are the garbage collector's.
            "propagationPolicy": "Background",
        }
        path = self._job_path(namespace, name)
        await self._call("DELETE", f"{path}?{self._until()}", options)

    async def patch_status(
        self,
        namespace: str,
        name: str,
        patch: Json,
        urgent: bool = True,  # noqa: ARG002 - the fence's matter
    ) -> Json:
        return await self._patch_status(self._job_path(namespace, name), patch)

    async def create_job(self, manifest: Json) -> Json:
        """Creates a SimulationJob in its namespace."""
        namespace = manifest["metadata"]["namespace"]
        return await self._create(self._path(namespace, names.PLURAL), manifest)

    async def try_job(self, manifest: Json) -> None:
        """Has a SimulationJob judged as if it were created; nothing is kept."""
        namespace = manifest["metadata"]["namespace"]
        await self._try(self._path(namespace, names.PLURAL), manifest)

    async def list_jobs(self, namespace: str, label: str, most: int | None = None) -> list[Json]:
        path = f"{self._path(namespace, names.PLURAL)}?labelSelector={label}&limit={PAGE}"
        found: list[Json] = []
        async for item in self._listed(path):
            found.append(trimmed(item))
            if len(found) == most:
                break
        return found

    async def job_uids(self, namespace: str | None) -> set[str]:
        """The UIDs of all SimulationJobs, without their specs; None: of all namespaces."""
        return await self._uids(namespace, names.PLURAL)

    async def schedule_uids(self, namespace: str | None) -> set[str]:
        """The same of all SimulationSchedules."""
        return await self._uids(namespace, names.SCHEDULE_PLURAL)

    async def _uids(self, namespace: str | None, plural: str) -> set[str]:
        scope = f"/namespaces/{namespace}" if namespace else ""
        path = f"/apis/{names.API_VERSION}{scope}/{plural}?limit={PAGE}"
        listed = self._listed(path, accept=_METADATA_ALONE)
        return {item["metadata"]["uid"] async for item in listed}

    async def _listed(self, path: str, accept: str = _JSON) -> AsyncIterator[Json]:
        """The objects of a list, page by page."""
        following = ""
        while True:
            page = await self._call("GET", path + following, accept=accept)
            for item in page.get("items") or []:
                yield item
            token = (page.get("metadata") or {}).get("continue")
            if not token:
                return
            following = f"&continue={token}"

    async def delete_job(self, namespace: str, name: str, uid: str) -> None:
        """Deletes a SimulationJob if it still is the one with that UID; gone is no error.

        Its children are deleted after it.
        """
        await self._delete(
            self._job_path(namespace, name), uid, {"propagationPolicy": "Background"}
        )

    async def get_schedule(self, namespace: str, name: str) -> Json:
        return await self._call("GET", self._path(namespace, names.SCHEDULE_PLURAL, name))

    async def patch_schedule_status(self, namespace: str, name: str, patch: Json) -> Json:
        """Merges into a SimulationSchedule's status; the schedule as it is afterwards."""
        path = self._path(namespace, names.SCHEDULE_PLURAL, name)
        return await self._patch_status(path, patch)

    async def get_lease(self, namespace: str, name: str) -> Json:
        return await self._call("GET", self._lease_path(namespace, name))

    async def create_lease(self, manifest: Json) -> Json:
        path = self._lease_path(manifest["metadata"]["namespace"])
        return await self._call("POST", path, manifest)

    async def replace_lease(self, manifest: Json) -> Json:
        meta = manifest["metadata"]
        return await self._call("PUT", self._lease_path(meta["namespace"], meta["name"]), manifest)

    async def check_watchable(self, namespace: str | None) -> None:
        """Raises ApiError when a CRD is not there, or jobs, schedules or pods can't be listed."""
        scope = f"/namespaces/{namespace}" if namespace else ""
        await self._call("GET", f"/apis/{names.API_VERSION}{scope}/{names.PLURAL}?limit=1")
        schedules = f"{scope}/{names.SCHEDULE_PLURAL}?limit=1"
        await self._call("GET", f"/apis/{names.API_VERSION}{schedules}")
        await self._call("GET", f"/api/v1{scope}/pods?limit=1")

    @staticmethod
    def _lease_path(namespace: str, name: str = "") -> str:
        path = f"/apis/coordination.k8s.io/v1/namespaces/{namespace}/leases"
        return f"{path}/{name}" if name else path

    @staticmethod
    def _job_path(namespace: str, name: str) -> str:
        return KubernetesApi._path(namespace, names.PLURAL, name)

    @staticmethod
    def _path(namespace: str, plural: str, name: str = "") -> str:
        below = f"/apis/{names.API_VERSION}/namespaces/{namespace}/{plural}"
        return f"{below}/{name}" if name else below

    def _until(self) -> str:
        """The query by which the API server gives up a write before we do, or may write no more."""
        return _given_up_after(min(self._deadline, self._writes_for()))

    async def _create(self, path: str, manifest: Json) -> Json:
        """Creates an object in the collection at a path; the object as it is then."""
        return await self._call("POST", f"{path}?{self._until()}", manifest)

    async def _try(self, path: str, manifest: Json) -> None:
        """Has an object judged as if it were created in the collection at a path."""
        query = _given_up_after(self._deadline)
        await self._call("POST", f"{path}?dryRun=All&{query}", manifest)

    async def _patch_status(self, path: str, patch: Json) -> Json:
        """Merges into the status of the object at a path; the object as it is afterwards."""
        content_type = "application/merge-patch+json"
        path = f"{path}/status?{self._until()}"
        return await self._call("PATCH", path, patch, content_type=content_type)

    async def _delete(self, path: str, uid: str, more: Json | None = None) -> bool:
        """Deletes what is at a path if it has that UID; whether there was something to delete."""
        options = {"apiVersion": "v1", "kind": "DeleteOptions", "preconditions": {"uid": uid}}
        options |= more or {}
        try:
            await self._call("DELETE", f"{path}?{self._until()}", options)
        except ApiError as error:
            # Another object may have taken the name. Either way this one is gone.
            if not error.is_anothers(uid) and not error.is_gone(path.rpartition("/")[2]):
                raise
            return False
        return True

    async def _call(
        self,
        method: str,
        path: str,
        body: Json | None = None,
        content_type: str = _JSON,
        accept: str = _JSON,
    ) -> Json:
        """One call, counted with its status; 0 says that there was no answer."""
        begun, status = time.monotonic(), 0
        headers = {"Accept": accept, "Content-Type": content_type}
        try:
            answer = await self._answer(method, path, body, headers)
            status = 200
        except ApiError as error:
            status = error.status
            raise
        finally:
            self._counted(method, status, time.monotonic() - begun)
        return answer

    async def _answer(
        self, method: str, path: str, body: Json | None, headers: dict[str, str]
    ) -> Json:
        client: Any = self._client  # its methods carry no types
        resource, _, query = path.partition("?")
        try:
            request = await client.param_serialize(  # it may read the token's file
                method=method,
                resource_path=resource,
                query_params=[tuple(part.split("=", 1)) for part in query.split("&") if part],
                header_params=headers,
                body=body,
                auth_settings=["BearerToken"],
            )
            response = await client.call_api(*request, _request_timeout=self._deadline)
            data = await response.read()
        except ApiException as error:
            raise _refusal(error.status or 0, str(error.body or error.reason)) from error
        except TimeoutError as error:
            raise ApiError(0, TIMEOUT, f"{method} {resource}: no answer in time.") from error
        except (aiohttp.ClientError, ConfigException, OSError) as error:
            what = str(error) or type(error).__name__
            raise ApiError(0, "Unreachable", f"{method} {path}: {what}") from error
        if not 200 <= response.status < 300:
            raise _refusal(response.status, data.decode("utf-8", "replace"))
        try:
            answer = await read_answer(data, written=method == "PATCH")
        except ValueError:
            answer = None
        if not isinstance(answer, dict):
            raise ApiError(0, "Unreadable", f"{method} {path}: {data[:200]!r}")
        return answer


def _given_up_after(seconds: float) -> str:
    """The query by which the API server gives up before we do, after so many seconds.

    It then says so, and names the webhook that it waits for if that is not to be left out.
    """
    bound = seconds - ANSWER_SECONDS
    return f"timeout={1000 * bound:.0f}ms" if bound >= SHORTEST_CREATION_SECONDS else ""


def _refusal(status: int, text: str) -> ApiError:
    """The API server explains itself in a Status object; proxies in front of it do not."""
    try:
        answer = loads(text)
    except ValueError:
        return ApiError(status, "Unknown", text[:500])
    if not isinstance(answer, dict):
        return ApiError(status, "Unknown", text[:500])
    message = _shortened(str(answer.get("message") or text[:500]))
    return ApiError(status, str(answer.get("reason") or "")[:_LONGEST_REFUSAL], message)


def _shortened(message: str) -> str:
    """A refusal quotes a wrong value once for each rule that it breaks, and is kept by job."""
    more = len(message) - _LONGEST_REFUSAL
    return f"{message[:_LONGEST_REFUSAL]} [cut: {more} more characters]" if more > 0 else message
