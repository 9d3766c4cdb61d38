"""What Spark's status store knows, as Python values: asked of the JVM in one call, as JSON."""

import json
from typing import Any

from pyspark import SparkContext


def status_store(spark: SparkContext) -> Any:
    """Its own figures and lists. Raises Py4JError, OSError or AttributeError once Spark is gone."""
    # pyspark offers no public way to its JVM.
    return spark._jsc.sc().statusStore()  # noqa: SLF001


def as_json(spark: SparkContext, value: Any) -> Any:
    """An object of the JVM as JSON has it. Raises as `status_store` does."""
    jvm: Any = spark._jvm  # noqa: SLF001
    jackson = jvm.com.fasterxml.jackson
    mapper = jackson.databind.ObjectMapper()
    mapper.registerModule(jackson.module.scala.DefaultScalaModule())
    return json.loads(mapper.writeValueAsString(value))
