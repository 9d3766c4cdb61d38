"""Spark's figures of its executors, without a Spark: who asks it, and what is kept of that."""

import gc
import threading
import weakref
from types import SimpleNamespace

import pytest

from bagpipe.driver import spark_executors
from bagpipe.driver.spark_executors import SparkExecutors


@pytest.fixture(autouse=True)
def spark(monkeypatch: pytest.MonkeyPatch) -> None:
    active = SimpleNamespace(_active_spark_context=object())
    monkeypatch.setattr(spark_executors, "SparkContext", active)
    known = [{"id": "1", "isActive": True}, {"id": "driver", "isActive": True}]
    figures = {field: 2 for _, _, _, field, _ in spark_executors._FIELDS}
    monkeypatch.setattr(spark_executors, "_asked_of_spark", lambda: [e | figures for e in known])


def registered(executors: SparkExecutors) -> list[float]:
    [states] = [each for each in executors.collect() if each.name == "bagpipe_executors"]
    return [sample.value for sample in states.samples]


def test_the_driver_is_no_executor() -> None:
    assert registered(SparkExecutors(lambda: 3)) == [3, 1]


def test_of_the_jobs_that_a_driver_had_no_thread_is_left_and_nothing_else() -> None:
    """A driver of a pool has a thousand, and for each thread that asks the JVM has one, too."""
    registered(SparkExecutors(lambda: 3))
    before, left = threading.active_count(), list[weakref.ref[SparkExecutors]]()
    for _ in range(20):
        executors = SparkExecutors(lambda: 3)
        assert registered(executors) == [3, 1]
        left.append(weakref.ref(executors))
        del executors
    assert threading.active_count() == before
    gc.collect()
    assert not any(ref() for ref in left)
