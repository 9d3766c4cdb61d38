"""What the driver says is what the operator understands and what the API server accepts."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from bagpipe.driver.__main__ import progress_of
from bagpipe.driver.comparing import Compared
from bagpipe.driver.progress import Progress
from bagpipe.plan.made import Unplanned
from bagpipe.run.case_run import unplanned_row
from bagpipe.spec import JobFile
from bagpipe_operator.jobs.driver.ending import ending_of
from bagpipe_operator.jobs.driver.progress import parse
from bagpipe_operator.jobs.pods.job_config import job_file, read_spec
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import START, make_driver, make_job

CRD = Path(__file__).parents[3] / "crds/simulationjobs.yaml"


def status_schema() -> dict[str, Any]:
    crd = yaml.load(CRD.read_text(), Loader=yaml.CSafeLoader)
    schema: dict[str, Any] = crd["spec"]["versions"][0]["schema"]["openAPIV3Schema"]
    fields: dict[str, Any] = schema["properties"]["status"]["properties"]
    return fields


def ended_with(*outcomes: str) -> Progress:
    progress = Progress("pvc://results/r")
    progress.begin(len(outcomes))
    for number, outcome in enumerate(outcomes):
        progress.add(
            {
                "case": f"case-{number}",
                "outcome": outcome,
                "reason": "" if outcome == "passed" else "NothingRecorded",
                "message": "why",
                "attempts": 2,
                "result": {"ledger": {"sent": 5, "received": 5, "dropped": 0, "lead_in": 2}},
            }
        )
    progress.finish()
    return progress


@pytest.mark.parametrize(
    ("outcomes", "phase", "verdict"),
    [
        (["passed", "passed"], "Complete", "Passed"),
        (["passed", "failed"], "Complete", "Failed"),
        (["passed", "invalid"], "Complete", "Invalid"),
        (["passed", "errored"], "Failed", ""),
    ],
)
def test_every_end_is_understood_and_fits_the_schema(
    outcomes: list[str], phase: str, verdict: str
) -> None:
    written = ended_with(*outcomes)
    understood = parse(written.termination_message())
    assert understood is not None
    assert (understood.phase, understood.verdict) == (phase, verdict)
    status = understood.as_status()
    schema = status_schema()
    assert status.get("verdict") in (schema["verdict"]["enum"] if verdict else [None])
    assert status["cases"] == written.snapshot()["cases"]
    assert status["ledger"] == {"sent": 10, "received": 10, "dropped": 0, "leadIn": 4}
    assert set(status["cases"]) <= set(schema["cases"]["properties"])
    assert set(status) <= set(schema)


def test_a_driver_whose_spark_is_gone_is_replaced() -> None:
    progress = Progress("pvc://results/r")
    progress.begin(3)
    progress.lose("Spark's Java process is gone")
    pod = make_driver("x").ended(75, progress.termination_message()).view()
    ending = ending_of(pod, START)
    assert ending is not None
    assert (ending.lost, ending.reason) == (True, "DriverFailed")
    assert "ended before its job did: Spark's Java process is gone." in ending.message


def test_the_beginning_and_a_refused_bag_are_understood() -> None:
    progress = Progress("pvc://results/r")
    planning = parse(progress.termination_message())
    assert planning is not None
    assert planning.phase == "Planning"
    progress.begin(1)
    progress.add(unplanned_row(Unplanned("cut", "pvc://r/cut.bag", "BagCut", "x" * 5000)))
    progress.finish()
    refused = parse(progress.termination_message())
    assert refused is not None
    assert (refused.reason, refused.cases.errored, len(refused.failures)) == ("BagCut", 1, 1)


def test_a_driver_says_whose_it_is() -> None:
    """Whoever has its address next says another name, or another attempt."""
    job = make_job("x").view()
    written = job_file(job, read_spec(job), 2, Settings())
    understood = parse(progress_of(JobFile.model_validate(written)).termination_message())
    assert understood is not None
    assert (understood.uid, understood.attempt) == (job.uid, 2)
    for whose, believed in [
        ((job.uid, 2), True),
        ((job.uid, 1), False),
        (("uid-of-y", 2), False),
    ]:
        assert understood.is_of(*whose) is believed


def test_a_driver_receives_what_the_user_wrote_on_the_job() -> None:
    made = make_job("x")
    made.object["metadata"] |= {
        "creationTimestamp": "2026-11-20T04:00:00Z",
        "labels": {"branch": "main"},
        "annotations": {"sim.bagpipe.io/commit": "0c1f", "example.com/token": "not ours"},
    }
    job = made.view()
    written = JobFile.model_validate(job_file(job, read_spec(job), 1, Settings()))
    assert (written.labels, written.created) == ({"branch": "main"}, "2026-11-20T04:00:00Z")
    assert written.annotations == {"sim.bagpipe.io/commit": "0c1f"}


def test_an_account_with_long_words_in_any_language_is_understood() -> None:
    compared = Progress("pvc://results/out/lane/uid-7", planned=1)
    compared.add(
        {
            "case": "a",
            "outcome": "passed",
            "reason": "",
            "message": "",
            "attempts": 1,
            "result": None,
        }
    )
    compared.compare(Compared([], frozenset(), "ComparisonFailed", "KeyError: " + "k" * 6000))
    compared.finish()
    failed = Progress("pvc://results/out/lane/uid-7", planned=1)
    failed.warn("\U0001f697" * 300)
    failed.fail("StorageFailed", "\U0001f697" * 600)
    for progress, phase in ((compared, "Complete"), (failed, "Failed")):
        written = progress.termination_message()
        assert len(written) <= 4096
        understood = parse(written)
        assert understood is not None
        assert understood.phase == phase
        assert understood.message
