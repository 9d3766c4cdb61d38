"""Cases on a local Spark, as a cluster's driver has them: `bagpipe run --spark`."""

import logging
import os
import subprocess
import sys

from pyspark import SparkConf, SparkContext
from pyspark.java_gateway import launch_gateway

from bagpipe.driver import cases_on_spark
from bagpipe.driver.keep import Keeper
from bagpipe.driver.spark_context import local_settings
from bagpipe.plan.case import Case
from bagpipe.run.case_run import RunContext
from bagpipe.spec import JobFile

_JVM_SECONDS = 20.0

log = logging.getLogger("bagpipe.driver")


def run_cases(
    job: JobFile, cases: list[Case], context: RunContext, slots: int, keeper: Keeper
) -> None:
    """Run all cases in Spark's Python workers; Spark is gone when this returns."""
    # Spark's workers are to be this very Python, whatever PATH says.
    os.environ["PYSPARK_PYTHON"] = sys.executable
    # Nothing of Spark is to be reached from outside, whatever this machine's name means.
    os.environ["SPARK_LOCAL_IP"] = "127.0.0.1"
    logging.getLogger("py4j").setLevel(logging.WARNING)
    conf = SparkConf().setAll(list(local_settings(job, slots).items()))
    gateway = launch_gateway(conf)  # type: ignore[no-untyped-call]
    try:
        spark = SparkContext(conf=conf, gateway=gateway)
        try:
            cases_on_spark.run_cases(spark, cases, context, keeper)
        finally:
            spark.stop()
    finally:
        gateway.shutdown()
        _end(gateway.proc)


def _end(jvm: "subprocess.Popen[bytes]") -> None:
    """The JVM ends, and removes its folders, when nobody holds its stdin."""
    if jvm.stdin is not None:
        jvm.stdin.close()
    try:
        jvm.wait(timeout=_JVM_SECONDS)
    except subprocess.TimeoutExpired:
        log.warning("Spark's JVM did not end within %.0f s: killed", _JVM_SECONDS)
        jvm.kill()
        jvm.wait()
