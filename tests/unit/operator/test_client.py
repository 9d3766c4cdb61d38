"""The session with the API server: as whom, and through a proxy only where one is set."""

import pytest

from bagpipe_operator.cluster.connection import in_cluster, session_settings


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({}, False),
        ({"HTTPS_PROXY": ""}, False),
        ({"NO_PROXY": "*"}, False),
        ({"HTTPS_PROXY": "http://proxy.example:3128"}, True),
        ({"http_proxy": "http://proxy.example:3128"}, True),
    ],
)
def test_a_proxy_of_the_environment_is_used(environment: dict[str, str], expected: bool) -> None:
    assert session_settings(environment) == {"trust_env": expected}


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({"KUBERNETES_SERVICE_HOST": "10.0.0.1"}, True),
        ({"KUBERNETES_SERVICE_HOST": "10.0.0.1", "KUBECONFIG": "/k"}, False),
        ({}, False),
    ],
)
def test_kubeconfig_comes_first(environment: dict[str, str], expected: bool) -> None:
    assert in_cluster(environment) is expected
