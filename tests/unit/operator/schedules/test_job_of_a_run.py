"""What it means for a run that the API server does not take its job."""

import pytest

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.schedules.job import name_taken, refusal_of


@pytest.mark.parametrize(
    ("status", "text", "reason"),
    [
        (403, "exceeded quota: jobs", "QuotaExceeded"),
        (400, "unknown field", "CreationRefused"),
        (403, "no rights", "CreationRefused"),
        (413, "request is too large", "CreationRefused"),
        (422, "spec.stack: Required value", "CreationRefused"),
        (500, "failed calling webhook: no answer", "CreationRefused"),
        (504, "context deadline exceeded", "CreationRefused"),
        *(
            (code, 'admission webhook "jobs.example" denied the request: frozen', "CreationRefused")
            for code in (404, 409, 418, 429, 500, 504)
        ),
        (403, "namespace lanes is being terminated", None),
        (0, "no answer", None),
        (409, "it already exists", None),
        (429, "too many requests", None),
        (500, "etcd has no leader", None),
    ],
)
def test_a_job_that_is_not_taken_is_refused_or_the_fault_passes(
    status: int, text: str, reason: str | None
) -> None:
    refused = refusal_of(ApiError(status, "", text), "nightly-29")
    assert (refused and refused.reason) == reason
    if refused is not None:
        assert text in refused.message


def test_a_name_that_is_taken_is_reported_with_what_to_do() -> None:
    refused = name_taken("nightly-29", "lanes")
    assert refused.reason == "NameTaken"
    assert refused.message == (
        "the job nightly-29 exists in namespace lanes and does not belong to this schedule. "
        "Delete it, or give the schedule another name."
    )
