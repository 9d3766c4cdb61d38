"""The archive of Spark's classes: what it is made for is what a job's JVMs have."""

from __future__ import annotations

import os
import re
import sys
import zipfile
from pathlib import Path

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


def test_it_is_made_where_a_job_looks_for_it() -> None:
    dockerfile = (ROOT / "images/spark/Dockerfile").read_text()
    assert f"class_archive.py archive {CLASS_ARCHIVE}\n" in dockerfile
    assert f"COPY --from=archive {CLASS_ARCHIVE} {CLASS_ARCHIVE}\n" in dockerfile
    entrypoint = re.search(r'ENTRYPOINT \[.*"(\S+)"\]', dockerfile)
    assert entrypoint is not None
    assert entrypoint[1] == class_archive.ENTRYPOINT
    assert os.access(ROOT / "images/spark/entrypoint.sh", os.X_OK)
