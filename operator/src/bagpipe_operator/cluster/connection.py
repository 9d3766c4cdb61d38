"""The connection with the API server: as whom, and through a proxy where one is set."""

import os
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Any

from kubernetes.aio import config
from kubernetes.aio.client import ApiClient, Configuration

PROXY_VARIABLES = ("HTTPS_PROXY", "https_proxy", "HTTP_PROXY", "http_proxy")


@asynccontextmanager
async def connected() -> AsyncIterator[ApiClient]:
    """A client for the pod's own cluster, or for KUBECONFIG outside of one."""
    configuration = Configuration(client_session_kwargs=session_settings(os.environ))
    load: Any = config  # its functions carry no types
    if in_cluster(os.environ):
        load.load_incluster_config(client_configuration=configuration)
    else:
        await load.load_kube_config(client_configuration=configuration)
    async with ApiClient(configuration=configuration) as client:
        yield client


def session_settings(environment: Mapping[str, str]) -> dict[str, Any]:
    """Settings of the HTTP session with the API server.

    aiohttp looks into the environment for a proxy, and into ~/.netrc for a password, in a thread
    of its own and for each request: two thirds of a call's processor time.
    """
    return {"trust_env": uses_proxy(environment)}


def uses_proxy(environment: Mapping[str, str]) -> bool:
    """Whether the environment names a proxy."""
    return any(environment.get(name) for name in PROXY_VARIABLES)


def in_cluster(environment: Mapping[str, str]) -> bool:
    """Whether the pod's own ServiceAccount is to be used; KUBECONFIG always comes first."""
    return "KUBECONFIG" not in environment and "KUBERNETES_SERVICE_HOST" in environment
