"""The session with the API server looks for a proxy only where one is set."""

import pytest

from bagpipe_operator.main import session_settings


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
