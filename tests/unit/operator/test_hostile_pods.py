"""Pods of whoever may create some: what is kept of one has a bound, however large the pod is."""

import json
from dataclasses import fields, is_dataclass
from typing import Any

import pytest

from bagpipe_operator.api import names
from bagpipe_operator.cluster.large_objects import read_event
from bagpipe_operator.jobs.pod_view import MOST_CLAIMS, MOST_CONTAINERS, PodView
from tests.unit.operator.builders import make_driver, make_executor

MEGABYTE = 1_400_000
LONG = "c" * MEGABYTE


def characters(kept: Any) -> int:
    """Of all texts of a view."""
    if is_dataclass(kept):
        return sum(characters(getattr(kept, field.name)) for field in fields(kept))
    if isinstance(kept, tuple):
        return sum(map(characters, kept))
    return len(kept) if isinstance(kept, str) else 0


def claims(*called: str) -> dict[str, Any]:
    volumes = [
        {"name": f"v{place}", "persistentVolumeClaim": {"claimName": name}}
        for place, name in enumerate(called)
    ]
    return {"containers": [], "volumes": volumes}


def status(**changed: Any) -> dict[str, Any]:
    return {"phase": "Pending"} | changed


def waiting(count: int, **changed: str) -> list[dict[str, Any]]:
    state = {"waiting": {"reason": "InvalidImageName", "message": "no"} | changed}
    return [{"name": f"c{place}", "image": "i", "state": state} for place in range(count)]


def condition(kind: str, status: str, **changed: str) -> list[dict[str, str]]:
    return [{"type": kind, "status": status} | changed]


LARGE: dict[str, tuple[str, dict[str, Any]]] = {
    "one claim": ("spec", claims(LONG)),
    "thousands of claims": ("spec", claims(*(f"claim-{n}" for n in range(20_000)))),
    "an image": ("status", status(containerStatuses=[waiting(1)[0] | {"image": LONG}])),
    "a container's message": ("status", status(containerStatuses=waiting(1, message=LONG))),
    "a container's reason": ("status", status(containerStatuses=waiting(1, reason=LONG))),
    "thousands of containers": ("status", status(containerStatuses=waiting(10_000))),
    "thousands of first ones": ("status", status(initContainerStatuses=waiting(10_000))),
    "a message": ("status", status(message=LONG, reason=LONG)),
    "the scheduler's": (
        "status",
        status(conditions=condition("PodScheduled", "False", message=LONG)),
    ),
    "a disruption's": (
        "status",
        status(conditions=condition("DisruptionTarget", "True", message=LONG, reason=LONG)),
    ),
}


@pytest.mark.parametrize("what", LARGE)
async def test_what_is_kept_of_a_pod_has_a_bound(what: str) -> None:
    """330 pods with a claim of such a name took the operator's 512 MiB."""
    where, large = LARGE[what]
    pod = make_executor("x").object()
    small = characters(PodView.from_object(pod))
    pod[where] = large
    line = json.dumps({"type": "ADDED", "object": pod}).encode()
    assert len(line) > 500_000
    read = json.loads(await read_event(line))["object"]
    assert characters(PodView.from_object(read)) - small <= 2 * 4_096


async def test_the_first_claims_and_containers_are_kept_whole() -> None:
    pod = make_executor("x").object()
    pod["spec"] = claims(LONG, "a", "b" * 253, *(f"claim-{n}" for n in range(100)))
    pod["status"] = status(containerStatuses=waiting(100), initContainerStatuses=waiting(100))
    view = PodView.from_object(pod)
    assert view.claims[:3] == ("a", "b" * 253, "claim-0")
    assert len(view.claims) == MOST_CLAIMS
    assert len(view.containers) == 2 * MOST_CONTAINERS


def test_an_account_as_long_as_the_kubelet_takes_is_kept_whole() -> None:
    account = json.dumps({"message": "x" * 4_081})
    assert len(account) == 4_096
    (container,) = make_driver("x").ended(0, account).view().containers
    assert container.message == account


@pytest.mark.parametrize(("length", "kept"), [(128, 128), (129, 0), (250_000, 0)])
def test_a_shape_that_is_too_long_is_none(length: int, kept: int) -> None:
    pod = make_driver("x").object()
    pod["metadata"]["annotations"] = {names.ANNOTATION_SHAPE: "s" * length}
    assert len(PodView.from_object(pod).shape) == kept
