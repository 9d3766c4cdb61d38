"""A search of images over a real API server; the test is the operator that ends its jobs."""

import signal
import threading
from pathlib import Path

import pytest
import yaml

from tests.integration.control_plane.cli_process import CliProcess
from tests.integration.control_plane.client import Client, jobs
from tests.integration.control_plane.observe import a_job
from tests.integration.control_plane.server import ControlPlane
from tests.integration.control_plane.test_cli import report_end
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish

pytestmark = pytest.mark.integration

IMAGES = [f"lane:{number}" for number in range(6)]
FIRST_BAD = 4


def started(control_plane: ControlPlane, namespace: str, folder: Path) -> CliProcess:
    """The search, with all that it needs in a folder."""
    job = a_job("lane")
    job["spec"] |= {"suspend": True, "output": {"uri": "pvc://results/out"}}
    head = {"apiVersion": "sim.bagpipe.io/v1alpha1", "kind": "SimulationJob"}
    (folder / "job.yaml").write_text(yaml.safe_dump(head | job))
    (folder / "images").write_text("\n".join(IMAGES))
    words = ["bisect", str(folder / "job.yaml"), "--case", "a-1", "-n", namespace]
    words += ["--good", IMAGES[0], "--bad", IMAGES[-1], "--images", str(folder / "images")]
    return CliProcess(control_plane.kubeconfig, *words, "--volume", f"results={folder}")


def operate(admin: Client, namespace: str, folder: Path, ended: threading.Event) -> None:
    """Ends each job as its image does: with results in which the case a-1 passes or fails."""
    seen: set[str] = set()
    while not ended.wait(0.1):
        for job in admin.items(jobs(namespace)):
            name, image = job["metadata"]["name"], job["spec"]["stack"]["image"]
            if name in seen or job["spec"].get("suspend"):
                continue
            seen.add(name)
            bad = IMAGES.index(image) >= FIRST_BAD
            row = make_row("a-1", "failed", "Bad") if bad else make_row("a-1")
            kept = publish(folder, [make_row("a-0", "failed", "Other"), row], uid=name)
            uri = f"pvc://results/{kept.relative_to(folder)}"
            report_end(admin, namespace, name, "Failed", results=uri)


def test_the_first_bad_image_is_found_and_no_job_is_left(
    control_plane: ControlPlane, admin: Client, namespace: str, tmp_path: Path
) -> None:
    ended = threading.Event()
    operator = threading.Thread(target=operate, args=(admin, namespace, tmp_path, ended))
    operator.start()
    try:
        with started(control_plane, namespace, tmp_path) as search:
            assert search.end() == 0, search.plain()
            text = " ".join(search.plain().split())
    finally:
        ended.set()
        operator.join()
    assert "lane:4 is the first bad one: lane:3, the one before it, is good" in text
    assert admin.items(jobs(namespace)) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_leaves_no_job(
    control_plane: ControlPlane, admin: Client, namespace: str, tmp_path: Path,
    number: signal.Signals,
) -> None:  # fmt: skip
    with started(control_plane, namespace, tmp_path) as search:
        search.read_until("lane:0: job lane-")
        search.signal(number)
        assert search.end() == 130, search.plain()
        assert "interrupted" in search.plain()
    assert admin.items(jobs(namespace)) == []
