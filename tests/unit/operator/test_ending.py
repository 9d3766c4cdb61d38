"""How a job ended, from its driver's pod."""

from datetime import timedelta

import pytest

from bagpipe_operator.jobs.driver.ending import Ending, lost_driver, overdue
from bagpipe_operator.jobs.driver.ending import ending_of as ending_at
from bagpipe_operator.jobs.pod_view import PodView
from tests.unit.operator.builders import START, PodBuilder, account, make_driver


def ending_of(driver: PodView) -> Ending | None:
    return ending_at(driver, START)


def test_a_running_driver_has_no_ending() -> None:
    assert ending_of(make_driver("x").view()) is None
    assert ending_of(make_driver("x").running().view()) is None


def test_exit_0_with_an_account_is_complete() -> None:
    text = account("Complete", reason="AllCasesPassed", message="4 of 4 cases passed.")
    ending = ending_of(make_driver("x").ended(0, text).view())
    assert ending is not None
    assert (ending.complete, ending.reason, ending.message) == (
        True,
        "AllCasesPassed",
        "4 of 4 cases passed.",
    )
    assert ending.progress is not None
    assert ending.progress.ledger.sent == 400


def test_a_failed_account_is_taken_over() -> None:
    text = account("Failed", reason="BagUnreadable", message="drive.bag ends at byte 17.")
    ending = ending_of(make_driver("x").ended(1, text).view())
    assert ending is not None
    assert (ending.complete, ending.reason, ending.message) == (
        False,
        "BagUnreadable",
        "drive.bag ends at byte 17.",
    )


def test_without_an_account_the_end_names_exit_status_and_log() -> None:
    for code, message in ((2, ""), (0, ""), (0, "not JSON")):
        ending = ending_of(make_driver("x").ended(code, message).view())
        assert ending is not None
        assert (ending.complete, ending.reason) == (False, "DriverFailed")
        assert ending.final_message == (
            f"The driver's pod x-1-driver ended with exit status {code} and without an account of "
            "its cases. Read its log: kubectl logs -n lanes x-1-driver"
        )


def test_a_good_account_does_not_outweigh_a_bad_exit() -> None:
    ending = ending_of(make_driver("x").ended(1, account("Complete")).view())
    assert ending is not None
    assert (ending.complete, ending.reason) == (False, "DriverFailed")
    assert "although its last account says Complete" in ending.message


def test_a_driver_that_lost_its_spark_is_lost_and_says_so() -> None:
    text = account(reason="SparkGone", message="Spark's Java process is gone")
    ending = ending_of(make_driver("x").ended(75, text).view())
    assert ending is not None
    assert (ending.complete, ending.lost, ending.reason) == (False, True, "DriverFailed")
    assert ending.final_message == (
        "The driver's pod x-1-driver ended before its job did: Spark's Java process is gone."
        " Read its log: kubectl logs -n lanes x-1-driver"
    )
    assert ending.progress is not None
    assert ending.progress.cases.passed == 1


def test_evicted_with_and_without_a_container_status() -> None:
    text = "The node was low on resource: memory."
    for pod in (make_driver("x"), make_driver("x").ended(137)):
        ending = ending_of(pod.evicted(text).view())
        assert ending is not None
        assert ending.reason == "DriverEvicted"
        assert ending.final_message == (
            f"The driver's pod x-1-driver was evicted. {text} Create the job again."
        )


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


WORDS = "The driver's pod x-1-driver"
AGAIN = "Create the job again."
# A driver that was cut short: by what, and all that is made of it.
CUT_SHORT = {
    "lack of memory": (
        make_driver("x").ended(137, reason="OOMKilled"),
        "DriverOutOfMemory",
        f"{WORDS} was ended for lack of memory.",
        "Raise spec.spark.driver.resources.memory and create the job again.",
    ),
    "its node's lack of memory": (
        make_driver("x").evicted("The node was low on resource: memory."),
        "DriverEvicted",
        f"{WORDS} was evicted. The node was low on resource: memory.",
        AGAIN,
    ),
    "an end of the whole pod": (
        PodBuilder("x-1-driver", "x", "driver", "Failed", {"reason": "NodeLost"}),
        "DriverLost",
        f"{WORDS} ended as Failed (NodeLost).",
        AGAIN,
    ),
    "an end that nobody explains": (
        PodBuilder("x-1-driver", "x", "driver", "Failed"),
        "DriverLost",
        f"{WORDS} ended as Failed (no reason).",
        AGAIN,
    ),
    "a deletion": (
        make_driver("x").ended(143).deleting(),
        "DriverLost",
        f"{WORDS} was deleted before its job ended.",
        AGAIN,
    ),
    "an exit without a word": (
        make_driver("x").ended(3),
        "DriverFailed",
        f"{WORDS} ended with exit status 3 and without an account of its cases.",
        "Read its log: kubectl logs -n lanes x-1-driver",
    ),
    "a lost node": (
        make_driver("x").running().deleting("2026-11-20T03:59:44Z"),
        "DriverLost",
        f"{WORDS} was deleted and its node does not say that it has ended.",
        AGAIN,
    ),
    "a taint of its node": (
        make_driver("x").ended(143).disrupted("DeletionByTaintManager", "Taint manager: deleting"),
        "DriverLost",
        f"{WORDS} was taken away (DeletionByTaintManager). Taint manager: deleting",
        AGAIN,
    ),
    "its node's wish": (
        make_driver("x").ended(143).disrupted("TerminationByKubelet", ""),
        "DriverEvicted",
        f"{WORDS} was evicted by its node.",
        AGAIN,
    ),
}


@pytest.mark.parametrize("cause", CUT_SHORT)
def test_a_driver_that_was_cut_short_is_lost_so_that_another_goes_on(cause: str) -> None:
    pod, reason, message, advice = CUT_SHORT[cause]
    ending = Ending(False, reason, message, advice=advice, lost=True, voluntary=False)
    assert ending_of(pod.view()) == ending


def test_the_kubelet_s_word_for_the_pod_says_more_than_that_of_the_disruption() -> None:
    pod = make_driver("x").ended(143).disrupted("PreemptionByScheduler", "preempting")
    pod.status["message"] = "Preempted by lane-9 on node 4."
    ending = ending_of(pod.view())
    assert ending is not None
    assert ending.message == (
        f"{WORDS} was evicted for a pod of a higher priority. Preempted by lane-9 on node 4."
    )


@pytest.mark.parametrize(
    ("exit_reason", "text", "reason", "lost"),
    [
        ("OOMKilled", "DriverFailed", "DriverOutOfMemory", True),  # Spark's JVM was killed
        ("OOMKilled", "BagUnreadable", "BagUnreadable", False),
        ("Error", "DriverFailed", "DriverFailed", False),
    ],
)
def test_an_account_counts_unless_it_shows_only_a_lack_of_memory(
    exit_reason: str, text: str, reason: str, lost: bool
) -> None:
    failed = account("Failed", reason=text, message="It failed.")
    ending = ending_of(make_driver("x").ended(1, failed, exit_reason).view())
    assert ending is not None
    assert (ending.complete, ending.reason, ending.lost) == (False, reason, lost)


def test_a_deleted_pod_is_overdue_15_s_after_it_should_be_gone() -> None:
    pod = make_driver("x").running().deleting("2026-11-20T04:00:00Z").view()
    for seconds, late in ((-30, False), (0, False), (15, False), (15.1, True), (900, True)):
        now = START + timedelta(seconds=seconds)
        assert overdue(pod, now) is late
        assert (ending_at(pod, now) is None) is not late
    assert not overdue(make_driver("x").running().view(), START)


def test_a_disruption_ends_a_driver_that_runs_only_when_its_pod_is_overdue() -> None:
    moved = make_driver("x").running().disrupted("EvictionByEvictionAPI", "moved")
    assert ending_of(moved.view()) is None
    assert ending_of(moved.deleting("2026-11-20T03:59:50Z").view()) is None
    late = ending_of(moved.deleting("2026-11-20T03:59:40Z").view())
    assert late is not None
    assert (late.reason, late.voluntary) == ("DriverEvicted", True)


def test_a_driver_that_has_vanished_ends_with_what_was_seen_last() -> None:
    deleted = "was deleted in namespace lanes before its job ended."
    unseen = Ending(False, "DriverLost", f"{WORDS} {deleted}", advice=AGAIN, lost=True)
    assert lost_driver("lanes", "x-1-driver") == unseen
    assert lost_driver("lanes", "x-1-driver", make_driver("x").view()) == unseen
    assert lost_driver("lanes", "x-1-driver", make_driver("x").running().view()) == unseen
    drained = make_driver("x").running().disrupted("EvictionByEvictionAPI", "moved")
    ending = lost_driver("lanes", "x-1-driver", drained.view())
    assert (ending.reason, ending.lost, ending.voluntary) == ("DriverEvicted", True, True)
