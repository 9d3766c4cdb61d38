"""`bagpipe pull` on a cluster: results on a claim, through a pod of the driver's image."""

from pathlib import Path

import pytest

from tests.e2e import jobs
from tests.e2e import kubectl as k
from tests.e2e.test_cli import bagpipe

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("recordings")]

MARKER = ".bagpipe-pull.jsonl"


def files_of(folder: Path) -> dict[str, bytes]:
    found = {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    found.pop(MARKER, None)
    return found


def test_a_claim_s_results_are_copied_byte_for_byte_and_no_pod_is_left(
    namespace: str, tmp_path: Path
) -> None:
    with jobs.applied(namespace, jobs.make_job("pulled")) as name:
        job = jobs.ended(namespace, name, 600)
        assert job["status"]["verdict"] == "Passed", jobs.account(namespace, job)
        k.take_results(namespace, job["status"]["results"], tmp_path / "copied")
        pulled = bagpipe(namespace, "pull", name, str(tmp_path / "pulled"))
        assert pulled.returncode == 0, pulled.stderr
        again = bagpipe(namespace, "pull", f"job/{name}", str(tmp_path / "pulled"))
        assert again.returncode == 0, again.stderr
        assert "0 files, 0 bytes in" in again.stderr
    found = files_of(tmp_path / "pulled")
    assert [each for each in found if each.startswith("cases/")]
    assert found == files_of(tmp_path / "copied")
    selector = ("-l", "app.kubernetes.io/name=bagpipe-pull")
    k.await_that("the pods to go", lambda: not k.items(namespace, "pods", *selector), 120)
