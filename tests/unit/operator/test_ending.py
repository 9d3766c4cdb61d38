"""How a job ended, from its driver's pod."""

import pytest

from bagpipe_operator.ending import Ending, lost_driver
from bagpipe_operator.ending import ending_of as ending_at
from bagpipe_operator.view import PodView
from tests.unit.operator.builders import START, account, make_driver


def ending_of(driver: PodView) -> Ending | None:
    return ending_at(driver, START)


def test_a_running_driver_has_no_ending() -> None:
    assert ending_of(make_driver("x").view()) is None
    assert ending_of(make_driver("x").running().view()) is None


def test_exit_0_with_an_account_is_complete() -> None:
    said = account("Complete", reason="AllCasesPassed", message="4 of 4 cases passed.")
    ending = ending_of(make_driver("x").ended(0, said).view())
    assert ending is not None
    assert (ending.complete, ending.reason, ending.message) == (
        True,
        "AllCasesPassed",
        "4 of 4 cases passed.",
    )
    assert ending.progress is not None
    assert ending.progress.ledger.sent == 400


def test_a_failed_account_is_taken_over() -> None:
    said = account("Failed", reason="BagUnreadable", message="drive.bag ends at byte 17.")
    ending = ending_of(make_driver("x").ended(1, said).view())
    assert ending is not None
    assert (ending.complete, ending.reason, ending.message) == (
        False,
        "BagUnreadable",
        "drive.bag ends at byte 17.",
    )


def test_no_account_tells_exit_status_and_where_the_log_is() -> None:
    for code, message in ((2, ""), (0, ""), (0, "not JSON")):
        ending = ending_of(make_driver("x").ended(code, message).view())
        assert ending is not None
        assert (ending.complete, ending.reason) == (False, "DriverFailed")
        assert ending.last_words == (
            f"The driver's pod x-1-driver ended with exit status {code} and without an account of "
            "its cases. Read its log: kubectl logs -n lanes x-1-driver"
        )


def test_a_good_account_does_not_outweigh_a_bad_exit() -> None:
    ending = ending_of(make_driver("x").ended(1, account("Complete")).view())
    assert ending is not None
    assert (ending.complete, ending.reason) == (False, "DriverFailed")
    assert "although its last account says Complete" in ending.message


def test_a_driver_that_lost_its_spark_is_lost_and_says_so() -> None:
    said = account(reason="SparkGone", message="Spark's Java process is gone")
    ending = ending_of(make_driver("x").ended(75, said).view())
    assert ending is not None
    assert (ending.complete, ending.lost, ending.reason) == (False, True, "DriverFailed")
    assert ending.last_words == (
        "The driver's pod x-1-driver ended before its job did: Spark's Java process is gone."
        " Read its log: kubectl logs -n lanes x-1-driver"
    )
    assert ending.progress is not None
    assert ending.progress.cases.passed == 1


def test_out_of_memory() -> None:
    ending = ending_of(make_driver("x").ended(137, reason="OOMKilled").view())
    assert ending is not None
    assert ending.reason == "DriverOutOfMemory"
    assert "Raise spec.spark.driver.resources.memory" in ending.last_words


def test_evicted_with_and_without_a_container_status() -> None:
    said = "The node was low on resource: memory."
    for pod in (make_driver("x"), make_driver("x").ended(137)):
        ending = ending_of(pod.evicted(said).view())
        assert ending is not None
        assert ending.reason == "DriverEvicted"
        assert ending.last_words == (
            f"The driver's pod x-1-driver was evicted. {said} Create the job again."
        )


def test_deleted_by_hand_while_it_ran() -> None:
    ending = ending_of(make_driver("x").ended(143).deleting().view())
    assert ending is not None
    assert (ending.reason, ending.complete) == ("DriverLost", False)


def test_a_driver_that_had_ended_well_before_it_was_deleted_has_completed() -> None:
    done = account("Complete", message="All 4 cases ran.", verdict="Passed")
    ending = lost_driver("lanes", "x-1-driver", make_driver("x").ended(0, done).deleting().view())
    assert (ending.complete, ending.message, ending.lost) == (True, "All 4 cases ran.", False)
    cut_short = lost_driver("lanes", "x-1-driver", make_driver("x").running().deleting().view())
    assert (cut_short.reason, cut_short.lost) == ("DriverLost", True)
    assert lost_driver("lanes", "x-1-driver").lost


@pytest.mark.parametrize(
    ("reason", "counted"),
    [
        ("EvictionByEvictionAPI", False),
        ("PreemptionByScheduler", False),
        ("DeletionByTaintManager", True),
        ("TerminationByKubelet", True),
        ("DeletionByPodGC", True),
    ],
)
def test_what_is_taken_for_another_s_sake_is_not_counted(reason: str, counted: bool) -> None:
    ending = ending_of(make_driver("x").ended(143).disrupted(reason, "moved").deleting().view())
    assert ending is not None
    assert (ending.lost, ending.voluntary) == (True, not counted)
