"""`helm test`: asks the API server whether this release is fit for jobs. Changes nothing.

`python -m bagpipe_operator.acceptance`, in a pod of the release; exit status 1 and a sentence for
each thing that is wrong.
"""

import asyncio
import copy
import os
import sys
from collections.abc import Mapping
from typing import Any

from kubernetes.aio import config
from kubernetes.aio.client import ApiClient, Configuration

from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError, KubernetesApi

REQUEST_SECONDS = 10.0
_BAG = "pvc://recordings/drive.bag"


class ReleaseApi(KubernetesApi):
    """The calls of the test, none of which leaves a trace."""

    async def served(self) -> list[str]:
        """The kinds that are served in Bagpipe's API group and version."""
        found = await self._call("GET", f"/apis/{names.API_VERSION}")
        return [each["kind"] for each in found.get("resources") or []]

    async def deployment(self, namespace: str, name: str) -> Json:
        """The operator's Deployment."""
        return await self._call("GET", f"/apis/apps/v1/namespaces/{namespace}/deployments/{name}")

    async def would_take(self, job: Json) -> None:
        """Raises ApiError if a job would be refused."""
        namespace = job["metadata"]["namespace"]
        path = f"/apis/{names.API_VERSION}/namespaces/{namespace}/{names.PLURAL}"
        await self._call("POST", f"{path}?dryRun=All", job)


def job(namespace: str) -> Json:
    """A job that is in order."""
    return {
        "apiVersion": names.API_VERSION,
        "kind": names.KIND,
        "metadata": {"name": "helm-test", "namespace": namespace},
        "spec": {
            "source": {"bags": [_BAG]},
            "stack": {"image": "example/stack:1", "command": ["roslaunch", "stack", "all.launch"]},
            "record": {"topics": ["/tf"]},
            "output": {"uri": "pvc://results/helm-test"},
        },
    }


def unfit_job(namespace: str) -> Json:
    """One that only a rule of the CRD can refuse: it would overwrite its own recording."""
    unfit = copy.deepcopy(job(namespace))
    unfit["spec"]["output"]["uri"] = _BAG
    return unfit


def not_ready(deployment: Json) -> str:
    """Why the operator does not work as the release wants it; empty when it does."""
    wanted, status = deployment["spec"].get("replicas", 1), deployment.get("status") or {}
    if status.get("observedGeneration", 0) < deployment["metadata"].get("generation", 1):
        return "Kubernetes has not seen the newest Deployment of the operator yet"
    # Kubernetes counts ready pods of all versions together: the earlier one's may be among them.
    earlier = max(0, status.get("replicas", 0) - status.get("updatedReplicas", 0))
    ready = max(0, status.get("readyReplicas", 0) - earlier)
    if ready < wanted:
        return f"{ready} of {wanted} pods of the operator are ready in their newest version"
    return ""


async def faults(api: ReleaseApi, release: str, operator: str, namespace: str) -> list[str]:
    """What is wrong with the release, one sentence each; raises ApiError for a lost connection."""
    try:
        kinds = await api.served()
    except ApiError as error:
        if error.status != 404:
            raise
        kinds = []
    found = [
        f"{kind}s of {names.API_VERSION} are not served: is their CRD installed?"
        for kind in (names.KIND, names.SCHEDULE_KIND)
        if kind not in kinds
    ]
    if names.KIND not in kinds:
        return found
    found += [not_ready(await api.deployment(release, operator))]
    try:
        await api.would_take(job(namespace))
    except ApiError as error:
        found.append(f"a job that is in order is refused in namespace {namespace}: {error.message}")
    try:
        await api.would_take(unfit_job(namespace))
        found.append(
            "a job that would overwrite its own recording is taken: the CRD lacks its rules"
        )
    except ApiError as error:
        if error.status != 422:
            found.append(f"an unfit job is refused for another reason: {error.message}")
    return [fault for fault in found if fault]


async def run(environment: Mapping[str, str]) -> list[str]:
    """The faults of the release that the environment names."""
    configuration = Configuration()
    load: Any = config  # its functions carry no types
    load.load_incluster_config(client_configuration=configuration)
    async with ApiClient(configuration=configuration) as client:
        return await faults(
            ReleaseApi(client, REQUEST_SECONDS),
            environment["BAGPIPE_RELEASE_NAMESPACE"],
            environment["BAGPIPE_OPERATOR_NAME"],
            environment["BAGPIPE_JOB_NAMESPACE"],
        )


def main() -> None:
    """The module as a program."""
    try:
        found = asyncio.run(run(os.environ))
    except ApiError as error:
        found = [f"the API server can't be asked: {error}"]
    for fault in found:
        print(fault, file=sys.stderr)
    if found:
        sys.exit(1)
    print("jobs and schedules are served, jobs are checked, and the operator is ready")


if __name__ == "__main__":
    main()
