"""One local Spark with a small heap for all tests of this folder, and programs for it."""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from pyspark import SparkContext
from pyspark.sql import SparkSession

from bagpipe.driver.spark_context import QUICK_JVM
from tests.cached import cache

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "docs/examples/binpipe"
HEAP_BYTES = 512 << 20


@pytest.fixture(scope="session")
def spark() -> Iterator[SparkSession]:
    """Two workers, two attempts for a task, a heap that large results would not fit in."""
    os.environ["PYSPARK_PYTHON"] = sys.executable
    session = (
        SparkSession.builder.master("local[2, 2]")
        .appName("binpipe tests")
        .config("spark.driver.memory", "512m")
        .config("spark.driver.extraJavaOptions", QUICK_JVM)
        .config("spark.driver.host", "127.0.0.1")
        .config("spark.driver.bindAddress", "127.0.0.1")
        .config("spark.ui.enabled", "false")
        .config("spark.ui.showConsoleProgress", "false")
        # A worker's peak memory is to be that of one task, not of all tests before it.
        .config("spark.python.worker.reuse", "false")
        .config("spark.sql.shuffle.partitions", "2")
        .getOrCreate()
    )
    yield session
    session.stop()


@pytest.fixture
def context(spark: SparkSession) -> SparkContext:
    return spark.sparkContext


def python(*arguments: str | Path) -> Sequence[str]:
    """A command for a program of the tests' own Python."""
    return [sys.executable, *map(str, arguments)]


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A folder with nine files of 0 to 8,000 bytes, named by their sizes."""
    folder = tmp_path / "files"
    folder.mkdir()
    for number in range(9):
        (folder / f"{number}000.bin").write_bytes(os.urandom(number * 1000))
    return folder


def cargo_example(name: str) -> Path:
    """An example of the Rust SDK, as the build of all the agent's tests has made it: for a crate
    alone cargo would build what it needs again, with fewer features."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", cache() / "cargo-debug"))
    subprocess.run(
        ["cargo", "build", "--locked", "--quiet", "--workspace", "--example", name],
        cwd=ROOT / "images/agent",
        env={**os.environ, "CARGO_TARGET_DIR": str(target)},
        check=True,
        timeout=1200,
    )
    return target / "debug/examples" / name
