"""`helm test` finds what is wrong with a release, and nothing where it is fit."""

import json

import pytest

from bagpipe.spec import SimulationJobSpec
from bagpipe_operator import acceptance
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError

READY: Json = {
    "metadata": {"generation": 2},
    "spec": {"replicas": 1},
    "status": {"observedGeneration": 2, "replicas": 1, "readyReplicas": 1, "updatedReplicas": 1},
}


class FakeRelease(acceptance.ReleaseApi):
    """A release as the API server would show it; `refusals` by the output's URI."""

    def __init__(self, kinds: list[str], deployment: Json, refusals: dict[str, ApiError]) -> None:
        self.kinds, self.shown, self.refusals = kinds, deployment, refusals

    async def served(self) -> list[str]:
        return self.kinds

    async def deployment(self, namespace: str, name: str) -> Json:
        assert (namespace, name) == ("bagpipe-system", "bagpipe-operator")
        return self.shown

    async def would_take(self, job: Json) -> None:
        assert job["metadata"]["namespace"] == "lanes"
        error = self.refusals.get(job["spec"]["output"]["uri"])
        if error:
            raise error


KINDS = ["SimulationJob", "SimulationSchedule"]
GOOD, BAD = "pvc://results/helm-test", "pvc://recordings/drive.bag"
RULE = ApiError(422, "Invalid", "output.uri is equal to a bag")


async def faults(
    kinds: list[str] | None = None, deployment: Json = READY, **refusals: ApiError
) -> list[str]:
    by_uri = {GOOD if key == "good" else BAD: error for key, error in refusals.items()}
    served = KINDS if kinds is None else kinds
    release = FakeRelease(served, deployment, by_uri)
    return await acceptance.faults(release, "bagpipe-system", "bagpipe-operator", "lanes")


async def test_a_fit_release() -> None:
    assert await faults(bad=RULE) == []


@pytest.mark.parametrize("missing", [KINDS, KINDS[:1], KINDS[1:]])
async def test_without_a_crd(missing: list[str]) -> None:
    """The operator watches both: without one of them it never becomes ready."""
    assert await faults(kinds=[kind for kind in KINDS if kind not in missing], bad=RULE) == [
        f"{kind}s of sim.bagpipe.io/v1alpha1 are not served: is their CRD installed?"
        for kind in missing
    ]


def counts(replicas: int, updated: int, ready: int, seen: int = 2) -> Json:
    """A Deployment's status; Kubernetes leaves out what is 0."""
    reported = {"replicas": replicas, "updatedReplicas": updated, "readyReplicas": ready}
    return {"observedGeneration": seen} | {name: count for name, count in reported.items() if count}


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (counts(1, 1, 1, seen=1), "not seen"),
        (counts(0, 0, 0), "0 of 1 pods"),
        (counts(1, 1, 0), "0 of 1 pods"),
        # The earlier version's pod is ready, and its successor finds no node.
        (counts(1, 0, 1), "0 of 1 pods"),
        (counts(2, 1, 1), "0 of 1 pods"),
    ],
)
async def test_an_operator_that_is_not_ready(status: Json, words: str) -> None:
    (fault,) = await faults(deployment=READY | {"status": status}, bad=RULE)
    assert words in fault


@pytest.mark.parametrize("earlier", [0, 1])
async def test_an_earlier_pod_beside_a_ready_one_is_no_fault(earlier: int) -> None:
    status = counts(1 + earlier, 1, 1 + earlier)
    assert await faults(deployment=READY | {"status": status}, bad=RULE) == []


async def test_two_replicas_of_which_one_is_new() -> None:
    two = READY | {"spec": {"replicas": 2}, "status": counts(3, 1, 3)}
    (fault,) = await faults(deployment=two, bad=RULE)
    assert fault == "1 of 2 pods of the operator are ready in their newest version"


async def test_a_crd_without_its_rules() -> None:
    (fault,) = await faults()
    assert "is taken" in fault


async def test_a_good_job_that_is_refused() -> None:
    no = ApiError(403, "Forbidden", "not you")
    assert await faults(good=no, bad=no) == [
        "a job that is in order is refused in namespace lanes: not you",
        "an unfit job is refused for another reason: not you",
    ]


def test_the_jobs_differ_in_one_field_and_the_good_one_is_good() -> None:
    good, bad = acceptance.job("lanes"), acceptance.unfit_job("lanes")
    SimulationJobSpec.model_validate(good["spec"])
    assert bad["spec"]["output"] != good["spec"]["output"]
    good["spec"]["output"] = bad["spec"]["output"]
    assert json.dumps(good) == json.dumps(bad)
