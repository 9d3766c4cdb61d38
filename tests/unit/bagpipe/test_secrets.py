"""Credentials: which variables are taken over from Secrets, and that nothing of ours shows them."""

import json

import pytest

from bagpipe.driver.spark_context import DriverPod, spark_settings
from bagpipe.storage import Storage
from bagpipe.storage.environment import take_over_secrets
from tests.unit.bagpipe.jobs import make_job, make_spec

HIDDEN = "value-that-nobody-may-read"

# What would load code into the driver, or send its own token to a server of the Secret's choice.
NEVER_TAKEN = [
    "LD_PRELOAD", "PYTHONPATH", "PYTHONSTARTUP", "JAVA_TOOL_OPTIONS", "SPARK_DAEMON_JAVA_OPTS",
    "SPARK_CONF_DIR", "BAGPIPE_POD_IP", "PATH", "HADOOP_CONF_DIR", "HADOOP_OPTS",
    "AWS_WEB_IDENTITY_TOKEN_FILE", "AWS_ENDPOINT_URL_STS", "AWS_CONTAINER_CREDENTIALS_FULL_URI",
    "AWS_CONTAINER_AUTHORIZATION_TOKEN_FILE", "AWS_CONFIG_FILE", "AZURE_FEDERATED_TOKEN_FILE",
    "AZURE_AUTHORITY_HOST", "GOOGLE_APPLICATION_CREDENTIALS",
]  # fmt: skip


def test_names_of_storage_are_taken_over_and_no_others(monkeypatch: pytest.MonkeyPatch) -> None:
    import os  # noqa: PLC0415  its environment is what is tested

    given = {
        "BAGPIPE_SECRET_0_AWS_ACCESS_KEY_ID": "first",
        "BAGPIPE_SECRET_1_AWS_ACCESS_KEY_ID": "second",
        "BAGPIPE_SECRET_0_HADOOP_USER_NAME": "robot",
        "BAGPIPE_SECRET_0_GOOGLE_SERVICE_ACCOUNT_KEY": "{}",
        "BAGPIPE_SECRET_7_AZURE_STORAGE_ACCOUNT_KEY": "key",
    } | {f"BAGPIPE_SECRET_0_{name}": "/evil" for name in NEVER_TAKEN}
    environment = dict(given)
    monkeypatch.setattr(os, "environ", environment)
    take_over_secrets()
    assert {name: value for name, value in environment.items() if name not in given} == {
        "AWS_ACCESS_KEY_ID": "second",
        "HADOOP_USER_NAME": "robot",
        "GOOGLE_SERVICE_ACCOUNT_KEY": "{}",
        "AZURE_STORAGE_ACCOUNT_KEY": "key",
    }


def test_neither_spark_s_settings_nor_the_job_file_hold_a_credential(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("AWS_SECRET_ACCESS_KEY", "BAGPIPE_SECRET_0_AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, HIDDEN)
    job = make_job({}, storage={"secrets": ["s3-login"]}, output={"uri": "s3://results/x"})
    settings = json.dumps(spark_settings(job, DriverPod("x-1-driver", "lab", "10.0.0.1"), 1))
    for shown in (settings, job.model_dump_json(), repr(Storage({})), repr(make_spec())):
        assert HIDDEN not in shown
    assert "s3-login" in job.model_dump_json()
