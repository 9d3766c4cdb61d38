"""An operator that is ended at any moment, and an API server that goes away, lose nothing."""

import time

from tests.integration.control_plane.client import Client, core, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.fake_kubelet import FakeKubelet
from tests.integration.control_plane.observe import (
    UID_LABEL,
    await_lead,
    await_phase,
    children,
    create_jobs,
    expected_children,
    statuses,
)
from tests.integration.control_plane.server import ControlPlane
from tests.unit.operator.builders import account
from tests.waiting import PATIENCE, wait_until

QUICK = {"BAGPIPE_MISSING_DRIVER_SECONDS": "1"}


def test_what_happens_while_no_operator_runs_is_found(
    admin: Client, namespace: str, kubelet: FakeKubelet, operator_process: StartOperator
) -> None:
    create_jobs(admin, namespace, ["ends", "fails", "lost", "deleted"])
    operator = operator_process(**QUICK)
    await_phase(admin, namespace, "Pending", 4)
    operator.kill()

    kubelet.end(namespace, "ends-1-driver", 0, account("Complete", verdict="Passed"))
    kubelet.end(namespace, "fails-1-driver", 1, account("Failed", reason="NoBags"))
    admin.delete(core(namespace, "pods", "lost-1-driver"))
    admin.delete(jobs(namespace, "deleted"))
    # No finalizer waits for the operator, and the garbage collector needs none of its help.
    assert not admin.exists(jobs(namespace, "deleted"))
    wait_until(
        lambda: (
            "deleted-1" not in children(admin, namespace)["configmaps"]
            and "deleted-1-driver" not in children(admin, namespace)["pods"]
        ),
        PATIENCE,
        "a deleted job's children are left",
    )
    create_jobs(admin, namespace, ["new"])

    operator.start()
    await_phase(admin, namespace, "Complete", 1)
    await_phase(admin, namespace, "Failed", 1)
    second = core(namespace, "pods", "lost-2-driver")
    # After the pause of ten seconds before a driver is replaced.
    wait_until(lambda: admin.exists(second), PATIENCE, "no second driver")
    await_phase(admin, namespace, "Pending", 2)
    found = {name: (s["phase"], s["attempt"]) for name, s in statuses(admin, namespace).items()}
    assert found == {
        "ends": ("Complete", 1),
        "fails": ("Failed", 1),
        "lost": ("Pending", 2),
        "new": ("Pending", 1),
    }


def test_a_lone_operator_is_killed_in_the_middle(
    admin: Client, namespace: str, operator_process: StartOperator
) -> None:
    names = [f"k{number:02}" for number in range(15)]
    operator = operator_process(BAGPIPE_WORKERS="1", **QUICK)
    await_lead(operator)
    create_jobs(admin, namespace, names)
    wait_until(lambda: len(children(admin, namespace)["pods"]) >= 3, PATIENCE, "no drivers")
    operator.kill()
    before = {p["metadata"]["uid"] for p in admin.items(core(namespace, "pods"))}
    operator.start()
    await_phase(admin, namespace, "Pending", len(names))
    assert children(admin, namespace) == expected_children(names)
    assert before <= {p["metadata"]["uid"] for p in admin.items(core(namespace, "pods"))}
    assert {s["attempt"] for s in statuses(admin, namespace).values()} == {1}


def test_every_object_has_its_job_as_owner_and_none_a_finalizer(
    admin: Client, namespace: str, operator_process: StartOperator
) -> None:
    operator_process()
    create_jobs(admin, namespace, ["a"])
    await_phase(admin, namespace, "Pending", 1)
    job = admin.get(jobs(namespace, "a"))
    labelled = f"?labelSelector={UID_LABEL}={job['metadata']['uid']}"
    owned = [
        o for kind in ("pods", "configmaps") for o in admin.items(core(namespace, kind) + labelled)
    ]
    driver, config = (o["metadata"]["name"] for o in owned)
    assert (driver, config.rpartition("-")[0]) == ("a-1-driver", "a-1")
    for child in owned:
        (owner,) = child["metadata"]["ownerReferences"]
        assert (owner["uid"], owner["controller"]) == (job["metadata"]["uid"], True)
    for anything in (job, *owned):
        assert anything["metadata"].get("finalizers") is None
        assert not [k for k in anything["metadata"].get("annotations") or {} if "kopf" in k]


def test_the_api_server_goes_away_and_comes_back(
    control_plane: ControlPlane,
    namespace: str,
    kubelet: FakeKubelet,
    operator_process: StartOperator,
) -> None:
    admin = control_plane.admin
    operator = operator_process()
    create_jobs(admin, namespace, ["a", "b"])
    await_phase(admin, namespace, "Pending", 2)
    control_plane.stop_api_server()
    wait_until(lambda: "connect" in operator.logged().lower(), PATIENCE, "it did not notice")
    control_plane.start_api_server()
    back = time.monotonic()
    kubelet.end(namespace, "a-1-driver", 0, account("Complete", verdict="Passed"))
    create_jobs(admin, namespace, ["c"])
    await_phase(admin, namespace, "Complete", 1)
    await_phase(admin, namespace, "Pending", 2)
    print(f"all was written {time.monotonic() - back:.1f} s after the API server came back")
    assert operator.server.alive
    assert children(admin, namespace) == expected_children(["a", "b", "c"])
    assert {s["attempt"] for s in statuses(admin, namespace).values()} == {1}


def test_what_is_deleted_before_a_watch_begins_again_is_not_counted_for_long(
    admin: Client,
    namespace: str,
    kubelet: FakeKubelet,
    operator_process: StartOperator,
    control_plane: ControlPlane,
) -> None:
    """A new API server knows no events of before: kopf lists what is there, and nothing else."""
    operator = operator_process(**QUICK)
    create_jobs(admin, namespace, ["ended"])
    await_phase(admin, namespace, "Pending", 1)
    kubelet.end(namespace, "ended-1-driver", 0, account("Complete", verdict="Passed"))
    await_phase(admin, namespace, "Complete", 1)
    counted = 'bagpipe_jobs{phase="Complete"}'
    assert operator.metric(counted) == 1.0
    operator.pause()
    control_plane.stop_api_server()
    control_plane.start_api_server()
    # By the new one, which has no connection to the operator: the old one might report it.
    admin.delete(jobs(namespace, "ended"))
    operator.resume()
    wait_until(lambda: operator.metric(counted) == 0.0, 2 * PATIENCE, "it is counted for ever")
    again = "begins with a list again"
    wait_until(lambda: again in operator.logged(), PATIENCE, "the log does not say why")
