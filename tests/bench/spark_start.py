"""What the start of Spark on one machine takes: with `bagpipe run`'s settings, and without.

Each start is a process of its own; the two take turns.
"""

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pyspark

from tests.bench.rows import Row

ROOT = Path(__file__).parents[2]
STARTS = int(os.environ.get("BENCH_ROUNDS", "7"))
SECONDS = 300
ONCE = """
import resource, sys, time
from pyspark import SparkConf, SparkContext
from pyspark.java_gateway import launch_gateway
from bagpipe.driver.spark_context import QUICK_JVM, local_settings
from tests.unit.bagpipe.jobs import make_job

settings = local_settings(make_job({}), 2)
if sys.argv[1] == "default":
    options = settings["spark.driver.extraJavaOptions"]
    settings["spark.driver.extraJavaOptions"] = options.replace(QUICK_JVM, "")
begun = time.monotonic()
conf = SparkConf().setAll(list(settings.items()))
gateway = launch_gateway(conf)
context = SparkContext(conf=conf, gateway=gateway)
assert context.parallelize(range(4), 4).map(lambda number: number + 1).sum() == 10
seconds = time.monotonic() - begun
context.stop()
gateway.shutdown()
gateway.proc.stdin.close()
gateway.proc.wait(60)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(seconds, used.ru_utime + used.ru_stime)
"""


def start(way: str) -> tuple[float, float]:
    """One start: seconds until its tasks were done, and those of a processor until its end."""
    done = subprocess.run(
        [sys.executable, "-c", ONCE, way],
        cwd=ROOT, env=os.environ | {"PYSPARK_PYTHON": sys.executable},
        capture_output=True, text=True, timeout=SECONDS, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    seconds, used = done.stdout.split()
    return float(seconds), float(used)


def measure() -> tuple[Sequence[Row], Mapping[str, str], str]:
    """Seconds until the first four tasks are done, and of a processor until the end."""
    taken: dict[str, list[tuple[float, float]]] = {"quick": [], "default": []}
    for _ in range(STARTS):
        for way, found in taken.items():
            found.append(start(way))
    rows = [
        Row(
            "Spark's start on one machine", metric, "s",
            [found[place] for found in taken["quick"]],
            "all of the JVM's compilers", [found[place] for found in taken["default"]],
        )
        for place, metric in enumerate(("until the first tasks are done", "of a processor"))
    ]  # fmt: skip
    return rows, {"pyspark": pyspark.__version__}, f"{STARTS} starts of each, in turns"
