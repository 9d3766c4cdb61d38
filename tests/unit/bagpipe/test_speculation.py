"""Which cases get a copy on another executor: Spark's own rule, asked with a job's settings."""

from collections.abc import Mapping
from statistics import median

import pytest

from bagpipe.driver.spark_context import DriverPod, local_settings, spark_settings
from tests.unit.bagpipe.jobs import make_job

POD = DriverPod("pod", "lab", "198.18.0.9")
SLOTS = 2


def settings(timeout: str = "10m") -> dict[str, str]:
    job = make_job({}, playback={"caseTimeout": timeout}, spark={"executors": 3, "slots": SLOTS})
    return spark_settings(job, POD, 1)


def seconds(conf: str) -> float:
    assert conf.endswith("s")
    return float(conf.removesuffix("s"))


def copied(conf: Mapping[str, str], cases: int, ended: list[float], running: float) -> bool:
    """As TaskSetManager.checkSpeculatableTasks of Spark 4 decides of a task that reads no rows."""
    of = {name.removeprefix("spark.speculation."): text for name, text in conf.items()}
    if conf.get("spark.speculation") != "true":
        return False
    if len(ended) >= max(1, int(float(of["quantile"]) * cases)):
        least = float(of["multiplier"]) * median(ended)
        # Where the efficiency of tasks counts, those without any wait twice as long.
        factor = 1 if of["efficiency.enabled"] == "false" else 2
        return running > factor * max(least, seconds(of["minTaskRuntime"]))
    slots = int(conf["spark.executor.cores"]) // int(conf["spark.task.cpus"])
    return cases <= slots and running > seconds(of["task.duration.threshold"])


@pytest.mark.parametrize(
    ("ended", "running", "copy"),
    [
        ([100.0] * 5, 299.0, False),
        ([100.0] * 5, 301.0, True),  # three times what the others took
        ([10.0, 20.0, 30.0, 1000.0, 1000.0], 91.0, True),  # of the median, not of the mean
        ([5.0] * 9, 59.0, False),
        ([5.0] * 9, 61.0, True),  # and not before a minute
        ([5.0] * 4, 3600.0, False),  # half of the cases must have ended
    ],
)
def test_a_case_of_ten_is_copied_after_three_times_the_median_of_the_others(
    ended: list[float], running: float, copy: bool
) -> None:
    assert copied(settings(), 10, ended, running) is copy


@pytest.mark.parametrize(
    ("timeout", "cases", "running", "copy"),
    [
        ("10m", SLOTS, 299.0, False),
        ("10m", SLOTS, 301.0, True),
        ("10m", 1, 301.0, True),
        ("10m", SLOTS + 1, 301.0, False),  # these have others to be compared with, later
        ("80s", 1, 59.0, False),
        ("80s", 1, 61.0, True),
    ],
)
def test_a_case_with_none_to_compare_with_is_copied_after_half_of_its_timeout(
    timeout: str, cases: int, running: float, copy: bool
) -> None:
    assert copied(settings(timeout), cases, [], running) is copy


def test_spark_looks_every_second_for_cases_to_copy() -> None:
    assert settings()["spark.speculation.interval"] == "1s"


def test_on_one_machine_no_case_is_copied() -> None:
    assert not [name for name in local_settings(make_job({}), 4) if "speculation" in name]
