"""What kubectl shows of the API: a refusal with its sentence, and a field's explanation.

Each refusal by itself is asked of an API server in tests/integration/control_plane/test_crd.py.
"""

import json

import pytest

from tests.crds.table import refused
from tests.e2e import kubectl as k

pytestmark = pytest.mark.e2e


def test_kubectl_shows_what_to_write() -> None:
    row = next(row for row in refused() if row.name == "bags: rate 0")
    with pytest.raises(k.KubectlError) as refusal:
        k.kubectl("create", "-n", "default", "-f", "-", given=json.dumps(row.manifest))
    assert row.says in str(refusal.value)


def test_kubectl_explains_a_field() -> None:
    shown = k.kubectl("explain", "simjob.spec.stack.remap")
    assert "The player publishes the recorded topic" in shown
