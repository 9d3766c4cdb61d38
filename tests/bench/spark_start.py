"""What the starts of Spark take: with Bagpipe's settings, and without.

On one machine as `bagpipe run` starts it, and in a cluster: a driver and an executor with the
archive of classes that the image's build makes, for which this process is Kubernetes. Each start
is a process of its own; the two ways take turns.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import pyspark

from tests.bench.rows import Row

ROOT = Path(__file__).parents[2]
STARTS = int(os.environ.get("BENCH_ROUNDS", "7"))
SECONDS = 300
ONCE = """
import resource, sys, time
import class_archive
from bagpipe.driver.spark_context import QUICK_JVM, local_settings
from tests.unit.bagpipe.jobs import make_job

settings = local_settings(make_job({}), 2)
if sys.argv[1] == "default":
    options = settings["spark.driver.extraJavaOptions"]
    settings["spark.driver.extraJavaOptions"] = options.replace(QUICK_JVM, "")
begun = time.monotonic()
with class_archive.job(settings):
    seconds = time.monotonic() - begun
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(seconds, used.ru_utime + used.ru_stime)
"""
IN_A_CLUSTER = """
import os, sys, time
from pathlib import Path
import class_archive

class_archive.ENTRYPOINT = sys.argv[1]
if sys.argv[2] == "make":
    home = Path(os.environ["SPARK_HOME"])
    class_archive.one_class_path(home)
    class_archive.archive(home, Path(sys.argv[3]))
    sys.exit()

from bagpipe.driver.spark_context import CLASS_ARCHIVE, DriverPod, spark_settings
from tests.unit.bagpipe.jobs import make_job

def used(pid):
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

settings = dict(class_archive.SETTINGS)
if sys.argv[2] == "quick":
    own = spark_settings(make_job({}), DriverPod("x", "x", "127.0.0.1", has_archive=True), 1)
    for side in ("driver", "executor"):
        options = own[f"spark.{side}.extraJavaOptions"]
        settings[f"spark.{side}.extraJavaOptions"] = options.replace(CLASS_ARCHIVE, sys.argv[3])
class_archive.on_this_machine()
with class_archive.kubernetes() as server:
    settings |= server.settings(Path(sys.argv[3]).with_suffix(".token"))
    begun = time.monotonic()
    with class_archive.job(settings) as driver:
        seconds = time.monotonic() - begun
        (executor,) = server.executors.values()
        print(seconds, used(driver.pid), used(executor.pid))
"""


def program(text: str, *words: str, **environment: str) -> list[float]:
    """The numbers on the last line of what a Python program prints."""
    paths = f"{ROOT}:{ROOT / 'images/spark'}"
    done = subprocess.run(
        [sys.executable, "-c", text, *words],
        cwd=ROOT,
        env=os.environ | {"PYSPARK_PYTHON": sys.executable, "PYTHONPATH": paths} | environment,
        capture_output=True, text=True, timeout=SECONDS, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return [float(word) for word in done.stdout.splitlines()[-1].split() if word[0].isdigit()]


def in_turns(
    start: Mapping[str, Sequence[str]], text: str, **environment: str
) -> list[list[float]]:
    """For each figure the runs of the first way, then those of the second."""
    runs: dict[str, list[list[float]]] = {way: [] for way in start}
    for _ in range(STARTS):
        for way, words in start.items():
            runs[way].append(program(text, *words, **environment))
    ours, theirs = (
        [list(figure) for figure in zip(*found, strict=True)] for found in runs.values()
    )
    return [runs for pair in zip(ours, theirs, strict=True) for runs in pair]


def rows(case: str, metrics: Sequence[str], peer: str, found: Sequence[list[float]]) -> list[Row]:
    return [
        Row(case, metric, "s", found[2 * place], peer, found[2 * place + 1])
        for place, metric in enumerate(metrics)
    ]


def copied(target: Path) -> Path:
    """A SPARK_HOME whose jars can be moved, and their times changed."""
    installed = Path(pyspark.__file__).parent
    for name in ("bin", "jars", "python"):
        if (installed / name).exists():
            subprocess.run(["cp", "-r", str(installed / name), str(target / name)], check=True)
    return target


def measure() -> tuple[Sequence[Row], Mapping[str, str], str]:
    """Seconds until the first four tasks are done, and of processors."""
    until = "until the first tasks are done"
    local = in_turns({"quick": ["quick"], "default": ["default"]}, ONCE)
    found = rows(
        "Spark's start on one machine",
        [until, "of a processor"],
        "all of the JVM's compilers",
        local,
    )
    with tempfile.TemporaryDirectory() as folder:
        home, archive = copied(Path(folder)), f"{folder}/spark.jsa"
        words = {way: [str(ROOT / "images/spark/entrypoint.sh"), way, archive] for way in
                 ("make", "quick", "default")}  # fmt: skip
        program(IN_A_CLUSTER, *words.pop("make"), SPARK_HOME=str(home))
        cluster = in_turns(words, IN_A_CLUSTER, SPARK_HOME=str(home))
    metrics = [until, "of a processor, the driver", "of a processor, the executor"]
    found += rows("Spark's start in a cluster", metrics, "Spark's own settings", cluster)
    return found, {"pyspark": pyspark.__version__}, f"{STARTS} starts of each, in turns"
