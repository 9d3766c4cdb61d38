"""A bad job is refused by the API server itself, with a sentence that says what to write."""

from collections.abc import Iterator

import pytest
from embedded.api import ApiError

from tests.crds.table import Row, refused, taken
from tests.integration.control_plane.client import Client, Object, jobs
from tests.integration.control_plane.observe import a_job

pytestmark = pytest.mark.integration

# As kubectl sends it: nothing is kept, and unknown fields are refused.
DRY_RUN = "?dryRun=All&fieldValidation=Strict"


@pytest.mark.parametrize("row", taken(), ids=str)
def test_a_good_job_is_taken(row: Row, admin: Client) -> None:
    admin.create(f"{jobs('default')}{DRY_RUN}", row.manifest)


@pytest.mark.parametrize("row", refused(), ids=str)
def test_a_bad_job_is_refused_with_what_to_write(row: Row, admin: Client) -> None:
    with pytest.raises(ApiError) as refusal:
        admin.create(f"{jobs('default')}{DRY_RUN}", row.manifest)
    assert row.says in str(refusal.value)


@pytest.fixture
def kept(admin: Client, namespace: str) -> Iterator[str]:
    """The path of a job, which no operator need watch."""
    job = a_job("kept")
    job["spec"]["stack"]["parameters"] = {"/threshold": 0.5, "/gains": {"p": 1}}
    admin.create(jobs(namespace), job)
    yield jobs(namespace, "kept")
    admin.delete(jobs(namespace, "kept"))


@pytest.mark.parametrize(
    "change",
    [
        {"stack": {"image": "example/lane:2"}},
        {"stack": {"parameters": {"/threshold": 0.6}}},
        {"stack": {"parameters": {"/gains": {"p": 2}}}},
        {"stack": {"parameters": {"/more": True}}},
        {"spark": {"executors": 4}},
    ],
    ids=["another image", "a parameter", "a nested parameter", "one more", "executors"],
)
def test_the_spec_of_a_job_can_not_be_changed(kept: str, change: Object, admin: Client) -> None:
    with pytest.raises(ApiError) as refusal:
        admin.merge(kept, {"spec": change})
    assert (
        "can be changed once the job exists, and spec.spark while it is suspended, since its cases "
        "are already planned: delete the job, or create one with another name" in str(refusal.value)
    )
