"""The images that run programs while they are built, for arm64: built, and run, under an emulator.

    .venv/bin/python -m pytest tests/integration/release/test_arm64_images.py

`make release-platforms` comes first, as `make test-slow` does. The first run takes some 15 minutes.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator

import build
import context
import cross
import engines
import pytest
from context import VERSION
from lock import locked

from release import archives

pytestmark = [pytest.mark.slow, pytest.mark.timeout(4 * 3600)]

(ARM64,) = (target for target in cross.TARGETS if target.arch == "arm64")
SECONDS = 300.0
Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def buildah() -> Iterator[engines.Buildah]:
    """What has built both."""
    engine = engines.Buildah(ARM64)
    with locked(context.cache() / "images" / "lock"):
        engine.release()
        images = [each for each in context.foreign(ARM64) if each.base != "scratch"]
        assert [each.name for each in images] == ["operator", "spark"]
        build.ensure_all(engine, images, archives=True)
        yield engine
        engine.release()


def run_in(buildah: engines.Buildah, image: str) -> Run:
    """Runs a command in a container of an image, as the image's user, with nothing of its own."""
    name = f"{context.REGISTRY}/{image}:{VERSION}-arm64"
    container = buildah._ask("from", "--pull-never", name)
    assert container

    def run(*command: str) -> subprocess.CompletedProcess[str]:
        words = buildah._command("run", "--isolation=chroot", container, "--", *command)
        return subprocess.run(
            words, capture_output=True, text=True, timeout=SECONDS, check=False,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip

    return run


@pytest.fixture(scope="module")
def operator(buildah: engines.Buildah) -> Run:
    return run_in(buildah, "operator")


@pytest.fixture(scope="module")
def spark(buildah: engines.Buildah) -> Run:
    return run_in(buildah, "spark")


@pytest.mark.usefixtures("buildah")
@pytest.mark.parametrize("name", ["operator", "spark"])
def test_the_archive_is_of_arm64(name: str) -> None:
    (image,) = (each for each in context.foreign(ARM64) if each.name == name)
    found = archives.inspect(build.archive_of(image))
    assert found.platforms == "linux/arm64"
    assert found.name == image.reference


def test_the_operator_starts_and_misses_a_cluster(operator: Run) -> None:
    assert operator("python3", "-c", "import os; print(os.uname().machine)").stdout == "aarch64\n"
    assert operator("id", "-u").stdout == "10001\n"
    done = operator("bagpipe-operator")
    assert done.returncode == 1
    assert "Config not found: /home/bagpipe/.kube/config" in done.stderr


def test_spark_s_python_has_the_native_module_and_pyspark(spark: Run) -> None:
    code = (
        "import os, bagpipe, bagpipe.driver, bagpipe_bag, pyspark\n"
        "print(os.uname().machine, pyspark.__version__, bagpipe_bag.MemoryBag.__name__)"
    )
    assert spark("python3", "-c", code).stdout == "aarch64 4.3.0 MemoryBag\n"


def test_its_java_takes_the_archive_of_spark_s_classes(spark: Run) -> None:
    """Java ends with an error where it may not do without an archive that does not fit."""
    java = ["java", "-Xshare:on", "-XX:SharedArchiveFile=/opt/bagpipe/spark.jsa"]
    home = "/opt/bagpipe/lib/python3.11/site-packages/pyspark"
    java += ["-XX:+UseG1GC", "-Xlog:class+load", "-cp", f"{home}/conf:{home}/jars/*"]
    done = spark(*java, "org.apache.spark.SparkContext", "--none")
    lines = [line for line in done.stdout.splitlines() if "org.apache.spark.SparkContext " in line]
    assert len(lines) == 1, done.stdout[-2000:] + done.stderr
    assert "source: shared objects file" in lines[0]
