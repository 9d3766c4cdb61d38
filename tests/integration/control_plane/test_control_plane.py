"""What tests may rely on: the parts of this control plane are the real ones."""

import pytest
from embedded.api import ApiError

from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.fake_kubelet import FakeKubelet
from tests.integration.control_plane.observe import a_job, is_admitted
from tests.integration.control_plane.release import Installation
from tests.integration.control_plane.server import ControlPlane
from tests.unit.operator.builders import account
from tests.waiting import PATIENCE, wait_until


def a_pod(name: str) -> Object:
    return {
        "metadata": {"name": name},
        "spec": {"containers": [{"name": "driver", "image": "example/image:1"}]},
    }


def test_it_starts_within_its_time(control_plane: ControlPlane) -> None:
    assert control_plane.start_seconds < PATIENCE  # 10 s on an idle machine
    assert control_plane.admin.get("/version")["gitVersion"] == "v1.34.4"


def test_the_garbage_collector_works(admin: Client, namespace: str) -> None:
    owner = admin.create(core(namespace, "configmaps"), {"metadata": {"name": "owner"}})
    reference = {"apiVersion": "v1", "kind": "ConfigMap", "name": "owner"}
    reference["uid"] = owner["metadata"]["uid"]
    owned = {"metadata": {"name": "owned", "ownerReferences": [reference]}}
    admin.create(core(namespace, "configmaps"), owned)
    admin.delete(core(namespace, "configmaps", "owner"))
    path = core(namespace, "configmaps", "owned")
    wait_until(lambda: not admin.exists(path), PATIENCE, "the owned ConfigMap outlived its owner")


def test_pod_security_is_enforced(admin: Client, namespace: str) -> None:
    level = {"pod-security.kubernetes.io/enforce": "restricted"}
    admin.merge(f"/api/v1/namespaces/{namespace}", {"metadata": {"labels": level}})
    # The API server learns of a namespace's new level from a watch.
    lax = a_pod("lax")
    wait_until(lambda: not is_admitted(admin, namespace, lax), PATIENCE, "it is not enforced")
    with pytest.raises(ApiError, match="violates PodSecurity"):
        admin.create(core(namespace, "pods"), lax)


def test_pods_get_a_real_token_and_need_their_account(admin: Client, namespace: str) -> None:
    made = admin.create(core(namespace, "pods"), a_pod("plain"))
    assert [v["name"].startswith("kube-api-access") for v in made["spec"]["volumes"]] == [True]
    stranger = a_pod("stranger")
    stranger["spec"]["serviceAccountName"] = "nobody"
    with pytest.raises(ApiError, match='serviceaccount "nobody" not found'):
        admin.create(core(namespace, "pods"), stranger)


def test_the_operators_account_has_the_charts_rights(
    installation: Installation, namespace: str
) -> None:
    assert installation.client.items(core(namespace, "pods")) == []
    with pytest.raises(ApiError, match="cannot list resource") as refused:
        installation.client.items(core(namespace, "secrets"))
    assert refused.value.status == 403


def test_a_job_goes_from_its_creation_to_its_end(
    admin: Client, namespace: str, kubelet: FakeKubelet, operator_process: StartOperator
) -> None:
    operator_process()
    admin.create(jobs(namespace), a_job("whole"))
    driver = core(namespace, "pods", "whole-1-driver")
    wait_until(lambda: admin.exists(driver), PATIENCE, "the operator created no driver")
    kubelet.run(namespace, "whole-1-driver")
    kubelet.end(namespace, "whole-1-driver", 0, account("Complete", verdict="Passed"))

    def phase() -> object:
        return admin.get(jobs(namespace, "whole")).get("status", {}).get("phase")

    wait_until(lambda: phase() == "Complete", PATIENCE, "the job's end was not reported")
    admin.delete(jobs(namespace, "whole"))
    wait_until(lambda: not admin.exists(driver), PATIENCE, "the driver's pod outlived its job")


def test_a_deleted_pod_waits_for_its_node(
    admin: Client, namespace: str, kubelet: FakeKubelet
) -> None:
    path = core(namespace, "pods", "bound")
    admin.create(core(namespace, "pods"), a_pod("bound"))
    kubelet.bind(namespace, "bound")
    admin.delete(path)
    assert "deletionTimestamp" in admin.get(path)["metadata"]
    kubelet.remove(namespace, "bound")
    assert not admin.exists(path)


def test_the_api_server_can_go_and_come_back(control_plane: ControlPlane, namespace: str) -> None:
    control_plane.stop_api_server()
    with pytest.raises(OSError, match="does not answer"):
        control_plane.admin.get("/version")
    control_plane.start_api_server()
    assert control_plane.admin.exists(f"/api/v1/namespaces/{namespace}")
