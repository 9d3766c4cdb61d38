"""A ResourceQuota as the cap on a namespace's jobs: docs/operations/namespaces.md shows it."""

import re
from pathlib import Path

import pytest
import yaml
from embedded.api import ApiError

from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.observe import a_job
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.integration

PAGE = Path(__file__).parents[3] / "docs/operations/namespaces.md"
COUNTED = "count/simulationjobs.sim.bagpipe.io"


@pytest.fixture
def quota(admin: Client, namespace: str) -> Object:
    """The page's quota, for two jobs, in force."""
    found = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    made: Object
    (made,) = [o for o in map(yaml.safe_load, found) if o.get("kind") == "ResourceQuota"]
    assert COUNTED in made["spec"]["hard"]
    made["spec"]["hard"] = {COUNTED: "2"}
    made["metadata"]["namespace"] = namespace
    path = core(namespace, "resourcequotas")
    admin.create(path, made)
    quota_path = f"{path}/{made['metadata']['name']}"

    def counts() -> bool:
        return COUNTED in admin.get(quota_path).get("status", {}).get("used", {})

    wait_until(counts, PATIENCE, "the quota counts no jobs")
    return made


def test_the_job_beyond_the_quota_is_refused_in_the_words_of_the_page(
    admin: Client, namespace: str, quota: Object
) -> None:
    for name in ("first", "second"):
        admin.create(jobs(namespace), a_job(name))
    with pytest.raises(ApiError) as refused:
        admin.create(jobs(namespace), a_job("third"))
    assert refused.value.status == 403
    name = quota["metadata"]["name"]
    words = f"exceeded quota: {name}, requested: {COUNTED}=1, used: {COUNTED}=2"
    assert f"{words}, limited: {COUNTED}=2" in str(refused.value)
    page = PAGE.read_text().replace("\n> ", " ")
    assert words.replace("=2", "=50") in page


def test_a_job_that_ended_counts_until_it_is_deleted(
    admin: Client, namespace: str, quota: Object
) -> None:
    assert quota
    for name in ("first", "second"):
        admin.create(jobs(namespace), a_job(name))
    admin.merge(jobs(namespace, "first") + "/status", {"status": {"phase": "Complete"}})
    with pytest.raises(ApiError, match="exceeded quota"):
        admin.create(jobs(namespace), a_job("third"))
    admin.delete(jobs(namespace, "first"))

    def taken() -> bool:
        try:
            admin.create(jobs(namespace), a_job("third"))
        except ApiError as error:
            assert "exceeded quota" in str(error)
            return False
        return True

    wait_until(taken, PATIENCE, "a deleted job goes on counting")
