"""What the worlds of other tests are made of."""

from tests.integration.chromium import browser
from tests.integration.conftest import agent_binary, start_agent
from tests.integration.control_plane.conftest import (
    _helm,
    admin,
    control_plane,
    installation,
    kubelet,
    namespace,
    operator_process,
)
from tests.integration.control_plane.test_dashboards import cases, drivers, prometheus

__all__ = [
    "_helm",
    "admin",
    "agent_binary",
    "browser",
    "cases",
    "control_plane",
    "drivers",
    "installation",
    "kubelet",
    "namespace",
    "operator_process",
    "prometheus",
    "start_agent",
]
