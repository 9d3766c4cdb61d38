"""Notifications of a whole operator: a real API server, a real receiver, kills at bad moments."""

import base64
import json
from collections import Counter
from pathlib import Path

import pytest

from tests.integration.control_plane.client import Client, Object, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.fake_kubelet import FakeKubelet
from tests.integration.control_plane.observe import a_job, await_phase, create_jobs, statuses
from tests.integration.control_plane.operators import dying_operator
from tests.unit.operator.builders import account
from tests.unit.operator.notify.receiver_server import Faults, receiver_server
from tests.waiting import PATIENCE, wait_until

DONE = account("Complete", verdict="Passed")


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    """The folder that the chart's Secrets are mounted below, with a key of the receiver `team`."""
    folder = tmp_path / "keys" / "team"
    folder.mkdir(parents=True)
    (folder / "key").write_bytes(b"whsec_" + base64.b64encode(bytes(range(32))))
    return folder.parent


def settings(keys: Path, url: str, namespace: str) -> dict[str, str]:
    receivers = [{"name": "team", "url": url, "namespaces": [namespace]}]
    return {
        "BAGPIPE_NOTIFICATIONS": json.dumps(receivers),
        "BAGPIPE_NOTIFICATION_KEYS": str(keys),
    }


def naming(name: str, *receivers: str) -> Object:
    job = a_job(name)
    job["spec"]["notify"] = list(receivers)
    return job


def subjects(server: Faults) -> Counter[str]:
    """How often each job's end was received."""
    return Counter(json.loads(got.body)["subject"] for got in server.received)


def states(admin: Client, namespace: str) -> dict[str, list[str]]:
    return {
        name: [entry["state"] for entry in status.get("notifications", [])]
        for name, status in statuses(admin, namespace).items()
    }


def test_ends_are_notified_once_over_restarts_and_old_ends_never(
    admin: Client, namespace: str, kubelet: FakeKubelet, operator_process: StartOperator,
    keys: Path,
) -> None:  # fmt: skip
    create_jobs(admin, namespace, ["old"])
    operator = operator_process()
    await_phase(admin, namespace, "Pending", 1)
    kubelet.end(namespace, "old-1-driver", 0, DONE)
    await_phase(admin, namespace, "Complete", 1)
    operator.kill()

    with receiver_server("500", "200") as (url, server):
        second = operator_process(**settings(keys, url, namespace))
        for name in ("a", "b"):
            admin.create(jobs(namespace), naming(name, "team"))
        admin.create(jobs(namespace), naming("c", "teem"))
        await_phase(admin, namespace, "Pending", 3)
        for name in "abc":
            kubelet.end(namespace, f"{name}-1-driver", 0, DONE)
        await_phase(admin, namespace, "Complete", 4)
        wanted = {"old": [], "a": ["Delivered"], "b": ["Delivered"], "c": ["Unknown"]}
        wait_until(
            lambda: states(admin, namespace) == wanted, PATIENCE, "not all of them are settled"
        )
        # One of them was refused, and came again.
        assert sorted(subjects(server).values()) == [1, 2]
        assert second.metric('bagpipe_notifications_total{receiver="team",result="delivered"}') == 2
        second.kill()
        third = operator_process(**settings(keys, url, namespace))
        admin.create(jobs(namespace), naming("d", "team"))
        await_phase(admin, namespace, "Pending", 1)
        kubelet.end(namespace, "d-1-driver", 0, DONE)
        wanted["d"] = ["Delivered"]
        wait_until(lambda: states(admin, namespace) == wanted, PATIENCE, "d is not settled")
        assert (sum(subjects(server).values()), subjects(server)["d"]) == (4, 1)
        assert url not in second.logged() + third.logged()
    reasons = {
        c["reason"]
        for c in statuses(admin, namespace)["c"]["conditions"]
        if c["type"] == "Notified"
    }
    assert reasons == {"ReceiverUnknown"}


def test_a_kill_after_the_end_was_written_and_before_it_was_reported_is_made_up_for(
    admin: Client, namespace: str, kubelet: FakeKubelet, operator_process: StartOperator,
    keys: Path,
) -> None:  # fmt: skip
    with receiver_server() as (url, server):
        dying = {dying_operator.DIES: 'after PATCH .*/status\\S* .*"state": "Pending"'}
        first = operator_process(start=False, **settings(keys, url, namespace), **dying)
        first.server.command[-1:] = dying_operator.PROGRAM
        first.start()
        admin.create(jobs(namespace), naming("x", "team"))
        await_phase(admin, namespace, "Pending", 1)
        kubelet.end(namespace, "x-1-driver", 0, DONE)
        wait_until(lambda: first.ended() is not None, PATIENCE, "the operator did not die")
        assert (states(admin, namespace), server.received) == ({"x": ["Pending"]}, [])
        first.kill()
        operator_process(**settings(keys, url, namespace))
        wait_until(
            lambda: states(admin, namespace) == {"x": ["Delivered"]},
            PATIENCE,
            "nobody was notified",
        )
        assert subjects(server) == {"x": 1}
