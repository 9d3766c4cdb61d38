"""A driver over a real S3 server with the keys of a Secret, right ones and wrong ones."""

import json
import logging
from pathlib import Path

import pytest

from bagpipe.driver import __main__ as driver
from bagpipe.storage import Storage
from tests.integration.storage.conftest import QUICK
from tests.integration.storage.servers import ACCESS_KEY, BUCKET, SECRET_KEY, S3Server
from tests.unit.bagpipe.jobs import make_job

WRONG = "the-wrong-value-of-a-secret-key"


@pytest.fixture
def pod(s3: S3Server, credentials: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A pod's environment: what the operator makes of a Secret, and no variable of AWS's own."""
    # The driver sets these itself; so they are removed again after the test.
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_ENDPOINT_URL", "AWS_REGION"):
        credentials.setenv(name, "")
        credentials.delenv(name)
    credentials.setenv("BAGPIPE_SECRET_0_AWS_ACCESS_KEY_ID", ACCESS_KEY)
    credentials.setenv("BAGPIPE_SECRET_0_AWS_SECRET_ACCESS_KEY", SECRET_KEY)
    credentials.setenv("BAGPIPE_SECRET_0_AWS_ENDPOINT_URL", s3.url)
    return credentials


def test_a_secret_s_keys_open_the_bucket(pod: pytest.MonkeyPatch, s3_folder: str) -> None:
    del pod
    storage = Storage({}, QUICK)
    assert storage.put_once(f"{s3_folder}/x", b"x")
    assert storage.read_all(f"{s3_folder}/x", 1) == b"x"


def test_a_driver_that_is_refused_says_so_and_shows_no_secret(
    pod: pytest.MonkeyPatch,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
) -> None:
    pod.setenv("BAGPIPE_SECRET_0_AWS_SECRET_ACCESS_KEY", WRONG)
    pod.setattr(driver, "PROGRESS_PORT", 0)
    caplog.set_level(logging.DEBUG)
    job = make_job(
        {},
        source={"bags": [f"s3://{BUCKET}/drive.bag"]},
        output={"uri": f"s3://{BUCKET}/results"},
        storage={"secrets": ["s3-login"]},
    )
    path = tmp_path / "job.json"
    path.write_text(job.model_dump_json(by_alias=True))
    assert driver.main(["--job", str(path)]) == 1
    (report,) = [r.getMessage() for r in caplog.records if r.getMessage().startswith("{")]
    ended = json.loads(report)
    assert (ended["phase"], ended["reason"]) == ("Failed", "StorageFailed")
    assert "the credential was refused (403" in ended["message"]
    # A driver first asks whether another one has committed.
    assert ended["message"].startswith(f"s3://{BUCKET}/results/drive/uid-1/manifest.json can't be")
    output = capfd.readouterr()
    for shown in (caplog.text, output.out, output.err, path.read_text()):
        assert all(hidden not in shown for hidden in (WRONG, SECRET_KEY, ACCESS_KEY))
