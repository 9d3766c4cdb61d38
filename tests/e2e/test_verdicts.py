"""A job's answer, on a cluster: two variants of a filter over the Jackal's recording, judged."""

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
import yaml

from tests.e2e import jobs
from tests.e2e import kubectl as k

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "docs/examples/localisation/job.yaml"
JACKAL = ROOT.parent / "shared/data/jackal_bz2.bag"

pytestmark = pytest.mark.e2e

MUST_END = "ends where it must"
CRITERIA = 5


@pytest.mark.parametrize(
    "manifest", ["localisation/job", "obstacles-node/job", "pedestrians-node/job",
                 "pedestrians-node/nobody"]
)  # fmt: skip
def test_the_api_server_accepts_an_application_s_manifest(namespace: str, manifest: str) -> None:
    path = ROOT / f"docs/examples/{manifest}.yaml"
    k.kubectl("-n", namespace, "apply", "--dry-run=server", "-f", str(path))


@pytest.mark.skipif(
    not JACKAL.exists(), reason=f"the recording {JACKAL.name} is not beside this checkout"
)
def test_two_variants_are_judged_and_compared(namespace: str) -> None:
    k.put(namespace, JACKAL, "jackal/jackal.bag")
    with jobs.applied(namespace, jobs.patient(yaml.safe_load(EXAMPLE.read_text()))) as name:
        status = jobs.ended(namespace, name, 400)["status"]
        assert (status["phase"], status["verdict"]) == ("Complete", "Failed"), status
        cases = status["cases"]
        counts = (cases["planned"], cases["passed"], cases["failed"], cases["errored"])
        assert counts == (2, 1, 1, 0)
        _, rows = k.results(namespace, status["results"])
        check_rows(rows)
        check_junit(read(namespace, status["results"], "junit.xml"))
        check_comparison(json.loads(read(namespace, status["results"], "comparison.json")))


def read(namespace: str, results: str, name: str) -> str:
    """A file beside the results."""
    return k.in_toolbox(namespace, "cat", "/" + results.removeprefix("pvc://") + "/" + name)


def check_rows(rows: list[k.Object]) -> None:
    """The published end pose is met by the tuned filter, and missed by the other one by metres."""
    by_variant = {row["variant"]: row for row in rows}
    tuned, trusting = by_variant["tuned"], by_variant["trusts-the-wheels"]
    assert (tuned["outcome"], trusting["outcome"]) == ("passed", "failed"), rows
    assert trusting["reason"] == "CriterionFailed"
    for row, figure in ((tuned, 0.0186), (trusting, 7.654)):
        found = {finding["name"]: finding for finding in row["criteria"]}
        assert len(found) == CRITERIA
        assert found[MUST_END]["figure"] == pytest.approx(figure, rel=0.03)
        assert found["answers every reading of the wheels"]["figure"] == 3060
        usage = row["result"]["stack"]["usage"]
        assert found["is cheap"]["figure"] == usage["peak_memory_bytes"] > 20 << 20
        assert 0 < usage["cpu_seconds"] < 2 * usage["seconds"]


def check_junit(text: str) -> None:
    """A suite for each variant; the failing one's case says what it missed, and by how much."""
    suites = {suite.get("name"): suite for suite in ET.fromstring(text)}  # noqa: S314
    assert set(suites) == {"tuned", "trusts-the-wheels"}
    assert suites["tuned"].findall("testcase/failure") == []
    (failure,) = suites["trusts-the-wheels"].findall("testcase/failure")
    assert failure.get("type") == "CriterionFailed"
    assert f"{MUST_END}: 7.6" in (failure.get("message") or ""), text


def check_comparison(document: k.Object) -> None:
    """Worse, by the end pose, which is a regression of the only fragment."""
    (comparison,) = document["comparisons"]
    assert (comparison["baseline"], comparison["variant"]) == ("tuned", "trusts-the-wheels")
    assert (comparison["verdict"], comparison["counts"]["regressed"]) == ("worse", 1)
    ends = {criterion["name"]: criterion for criterion in comparison["criteria"]}[MUST_END]
    assert ends["variant"] - ends["baseline"] == pytest.approx(7.64, abs=0.2)
