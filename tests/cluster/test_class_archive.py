"""The archive of Spark's classes: what it is made for is what a job's JVMs have."""

from __future__ import annotations

import http.client
import json
import os
import re
import sys
import threading
import zipfile
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from context import ROOT

sys.path.insert(0, str(ROOT / "images" / "spark"))
import class_archive

from bagpipe.driver.spark_context import CLASS_ARCHIVE, DriverPod, spark_settings
from tests.unit.bagpipe.jobs import make_job

# A job's own differ: its names, addresses, image and number of executors.
OF_THE_JOB = {
    "spark.app.name", "spark.kubernetes.namespace", "spark.kubernetes.container.image",
    "spark.kubernetes.driver.pod.name", "spark.driver.bindAddress", "spark.driver.host",
    "spark.executor.instances",
}  # fmt: skip

# Numbers and names, which load nothing, and what only a pod in a cluster has.
NOT_TRAINED = {
    "spark.decommission.enabled", "spark.driver.extraJavaOptions",
    "spark.excludeOnFailure.enabled", "spark.executor.cores",
    "spark.executor.decommission.signal", "spark.kubernetes.decommission.script",
    "spark.kubernetes.executor.terminationGracePeriodSeconds",
    "spark.executor.extraJavaOptions", "spark.executor.failuresValidityInterval",
    "spark.executor.heartbeatInterval", "spark.executor.maxNumFailures", "spark.executor.memory",
    "spark.executor.memoryOverhead", "spark.kubernetes.allocation.batch.delay",
    "spark.kubernetes.allocation.batch.size", "spark.kubernetes.authenticate.caCertFile",
    "spark.kubernetes.authenticate.oauthTokenFile",
    "spark.kubernetes.container.image.pullPolicy",
    "spark.kubernetes.executor.deleteOnTermination", "spark.kubernetes.executor.podNamePrefix",
    "spark.kubernetes.executor.podTemplateContainerName",
    "spark.kubernetes.executor.podTemplateFile", "spark.kubernetes.executor.request.cores",
    "spark.locality.wait", "spark.master", "spark.network.timeout", "spark.python.worker.reuse",
    "spark.speculation.efficiency.enabled", "spark.speculation.interval",
    "spark.speculation.minTaskRuntime", "spark.speculation.multiplier",
    "spark.speculation.quantile", "spark.speculation.task.duration.threshold", "spark.task.cpus",
    "spark.task.maxFailures", "spark.task.reaper.killTimeout",
}  # fmt: skip


def jars(home: Path, *names: str) -> Path:
    (home / "jars").mkdir(parents=True)
    for name in names:
        (home / "jars" / name).write_bytes(b"")
    return home


def class_path(home: Path) -> list[str]:
    """As a JVM reads it: lines that begin with a space go on with the one before."""
    with zipfile.ZipFile(home / "jars" / "class-path.jar") as jar:
        text = jar.read("META-INF/MANIFEST.MF").decode()
    assert max(map(len, text.split("\r\n"))) <= 72
    assert text.endswith("\r\n\r\n")
    found = re.fullmatch(
        r"Manifest-Version: 1\.0\nClass-Path: (.*)\n\n", re.sub(r"\n ", "", text.replace("\r", ""))
    )
    assert found is not None, text
    return found[1].split(" ")


def test_one_jar_names_all_others_in_one_order_with_slf4j_first(tmp_path: Path) -> None:
    many = [f"part-{number:03}-of-spark-2.13.jar" for number in range(280)]
    home = jars(tmp_path, *reversed(many), "slf4j-api-2.0.17.jar", "a.jar")
    # Spark Connect's shell has a folder there; a class path with a folder can't be archived.
    (home / "jars" / "connect-repl").mkdir()
    class_archive.one_class_path(home)
    assert class_path(home) == [
        f"../all-jars/{name}" for name in ["slf4j-api-2.0.17.jar", "a.jar", *many]
    ]
    assert [path.name for path in (home / "jars").iterdir()] == ["class-path.jar"]


def test_the_jars_have_whole_seconds_which_a_layer_keeps(tmp_path: Path) -> None:
    home = jars(tmp_path, "a.jar")
    class_archive.one_class_path(home)
    written = {path.stat().st_mtime_ns for path in home.glob("*/*.jar")}
    assert written == {class_archive.WRITTEN * 10**9}


def test_the_same_jars_give_the_same_bytes(tmp_path: Path) -> None:
    homes = [jars(tmp_path / n, *names) for n, names in (("1", "ab"), ("2", "ba"))]
    for home in homes:
        class_archive.one_class_path(home)
    first, second = [(home / "jars" / "class-path.jar").read_bytes() for home in homes]
    assert first == second


def test_the_training_has_a_job_s_own_settings() -> None:
    own = spark_settings(make_job({}), DriverPod("pod", "lab", "198.18.0.9"), 1)
    trained = class_archive.SETTINGS
    assert set(trained) <= set(own)
    assert {name for name in trained if trained[name] != own[name]} <= OF_THE_JOB
    # A setting that is new here: does it load other classes? Then the training needs it.
    assert set(own) - set(trained) == NOT_TRAINED


def asked(server: class_archive.Kubernetes, path: str, token: str, body: Any = None) -> Any:
    """What the answer holds, or its status."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=60)
    with closing(connection):
        connection.request(
            "GET" if body is None else "POST",
            f"/api/v1/namespaces/training/pods{path}",
            body=None if body is None else json.dumps(body),
            headers={"Authorization": f"Bearer {token}"},
        )
        answer = connection.getresponse()
        return json.load(answer) if answer.status == 200 else answer.status


POD = {
    "metadata": {"name": "training-exec-1", "labels": {"spark-exec-id": "1"}},
    "spec": {
        "containers": [{"env": [{"name": "SPARK_EXECUTOR_ID", "value": "1"}, {"name": "IP"}]}]
    },
}


def test_it_runs_what_spark_asks_for_and_says_how_it_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "entrypoint"
    variables = "$SPARK_EXECUTOR_ID $IP $SPARK_EXECUTOR_POD_NAME"
    program.write_text(f'#!/bin/sh\necho "$1" {variables} > {tmp_path}/written\n')
    program.chmod(0o755)
    monkeypatch.setattr(class_archive, "ENTRYPOINT", str(program))
    with class_archive.kubernetes() as server:
        own = asked(server, "?fieldSelector=metadata.name%3Dtraining", server.token)
        assert [pod["metadata"]["name"] for pod in own["items"]] == ["training"]
        assert asked(server, "?labelSelector=spark-role", server.token)["items"] == []
        made = asked(server, "", server.token, POD)
        assert made["metadata"]["labels"] == {"spark-exec-id": "1"}
        assert server.executors["training-exec-1"].wait(60) == 0
        (seen,) = asked(server, "?labelSelector=spark-role", server.token)["items"]
        assert (seen["metadata"]["uid"], seen["status"]) == ("training-exec-1", {"phase": "Failed"})
    assert (tmp_path / "written").read_text() == "executor 1 127.0.0.1 training-exec-1\n"


def test_it_runs_nothing_for_anybody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(class_archive, "ENTRYPOINT", "/bin/false")
    with class_archive.kubernetes() as server:
        for body in (None, POD):
            assert asked(server, "?labelSelector=spark-role", "", body) == 401
        assert server.executors == {}
        assert list(server.pods) == ["training"]


def test_a_training_that_waits_for_ever_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(class_archive, "SECONDS", 1)
    with (
        pytest.raises(class_archive.TrainingError, match="not done after 1 s"),
        class_archive.deadline(),
    ):
        threading.Event().wait(60)


def test_no_proxy_is_asked_for_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HTTP_PROXY", "https_proxy", "ALL_PROXY", "SPARK_LOCAL_HOSTNAME"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    monkeypatch.setenv("SPARK_LOCAL_IP", "192.0.2.1")
    class_archive.on_this_machine()
    assert not [name for name in os.environ if name.lower().endswith("_proxy")]
    assert os.environ["SPARK_LOCAL_IP"] == "127.0.0.1"
    assert os.environ["SPARK_LOCAL_HOSTNAME"] == "localhost"


def test_it_is_made_where_a_job_looks_for_it() -> None:
    dockerfile = (ROOT / "images/spark/Dockerfile").read_text()
    assert f"class_archive.py archive {CLASS_ARCHIVE}\n" in dockerfile
    assert f"COPY --from=archive {CLASS_ARCHIVE} {CLASS_ARCHIVE}\n" in dockerfile
    entrypoint = re.search(r'ENTRYPOINT \[.*"(\S+)"\]', dockerfile)
    assert entrypoint is not None
    assert entrypoint[1] == class_archive.ENTRYPOINT
    assert os.access(ROOT / "images/spark/entrypoint.sh", os.X_OK)
