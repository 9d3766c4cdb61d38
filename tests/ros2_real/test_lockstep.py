"""Lock-step under a real ROS 2: the same bytes each time, whatever else the machine does."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.ros2_real.conftest import MESSAGES
from tests.ros2_real.jobs import LOCKSTEP, NODE, PYTHON, SIM_TIME, Trial, ledger_of, passed
from tests.ros2_recording import BEGIN

PERIOD = 5_000_000
REENTRANT = ["--ros-args", "-p", "reentrant:=true"]
STACKS = {
    "rclcpp, one thread": [*NODE, "single", "Answering"],
    "rclcpp, events": [*NODE, "events", "Answering"],
    "rclcpp, four threads": [*NODE, "multi", "Answering", *REENTRANT],
    "rclpy, one thread": list(PYTHON),
}


@pytest.fixture
def busy() -> Iterator[None]:
    """Two loops that want a processor each."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    yield
    for loop in loops:
        loop.kill()
        loop.wait()


@pytest.mark.parametrize("stack", STACKS)
def test_two_runs_record_the_same_bytes(
    trial: Trial, require_executor: Callable[[str], None], stack: str
) -> None:
    if stack == "rclcpp, events":
        require_executor("events")
    digests = set()
    for _ in range(2):
        row = trial.run(trial.spec(STACKS[stack], LOCKSTEP))
        assert passed(row), row
        assert row["result"]["playback"]["steps"][0]["answered"] == MESSAGES
        digests.add(trial.digest(row))
    assert len(digests) == 1


@pytest.mark.parametrize("stack", ["rclcpp, one thread", "rclpy, one thread"])
def test_callbacks_see_the_time_of_their_message(trial: Trial, stack: str) -> None:
    job = trial.spec(STACKS[stack], LOCKSTEP, stack={"parameters": SIM_TIME})
    row = trial.run(job)
    assert passed(row), row
    texts = [text.split() for text in trial.texts(row)]
    assert [(words[0], words[-1]) for words in texts] == [
        (str(BEGIN + number * PERIOD),) * 2 for number in range(MESSAGES)
    ]


@pytest.mark.parametrize("recorded", [["/out"], ["/out", "/mid"]], ids=["out", "all"])
@pytest.mark.parametrize("work", [0, 2000])
@pytest.mark.parametrize("playback", [LOCKSTEP, {"mode": "lockstep"}], ids=["steps", "no steps"])
@pytest.mark.parametrize("executor", ["single", "multi", "events"])
def test_what_is_handed_over_within_a_process_belongs_to_its_step(
    trial: Trial,
    require_executor: Callable[[str], None],
    executor: str,
    playback: dict[str, Any],
    work: int,
    recorded: list[str],
) -> None:
    """What is recorded too is published twice, and rclcpp throws its copy away."""
    if executor == "events":
        require_executor("events")
    stack = {"parameters": SIM_TIME | {"/**/work_us": work}}
    command = [*NODE, executor, "Handing", "Handed"]
    row = trial.run(trial.spec(command, playback, stack=stack, record={"topics": recorded}))
    assert passed(row), row
    answers = [(time, *map(int, text.split())) for time, text in trial.timed_texts(row)]
    times = [BEGIN + number * PERIOD for number in range(MESSAGES)]
    assert answers == [(time, time, time) for time in times]
    assert not row["result"]["playback"].get("warnings")


def test_a_callback_of_rclpy_that_sleeps_is_waited_for(trial: Trial) -> None:
    """Longer than is waited for threads of which none is known to work: its answer belongs to the
    time of its message, without a step that awaits it."""
    command = [*PYTHON, "--ros-args", "-p", "sleeps:=5"]
    row = trial.run(trial.spec(command, {"mode": "lockstep"}))
    assert passed(row), row
    answers = [(time, int(text.split()[0])) for time, text in trial.timed_texts(row)]
    times = [BEGIN + number * PERIOD for number in range(MESSAGES)]
    assert answers == [(time, time) for time in times]


def test_timers_of_a_time_fire_before_its_message(trial: Trial) -> None:
    """Every 20 ms of simulated time a tick, which has how many messages there were by then. The
    first is when the clock begins, before there is anything to record. So is a second in Humble,
    where a timer is due once more at a time that is a multiple of its period."""
    playback = {"mode": "lockstep"}
    fields = {"stack": {"parameters": SIM_TIME}, "record": {"topics": ["/tick"]}}
    ticks = []
    for _ in range(3):
        row = trial.run(trial.spec([*NODE, "single", "Ticking"], playback, **fields))
        assert passed(row), row
        ticks.append((trial.digest(row), trial.texts(row, "/tick")))
    assert len({digest for digest, _ in ticks}) == 1, ticks
    reported = [[int(word) for word in text.split()] for text in ticks[0][1]]
    assert reported[0][0] in (2, 3)
    for number, (tick, at, seen) in enumerate(reported, reported[0][0]):
        assert (tick, seen) == (number, (at - BEGIN) // PERIOD)
    assert len(reported) >= MESSAGES // 4 - 1


def test_the_timers_of_a_node_that_starts_slowly_are_due_when_those_of_a_quick_one_are(
    trial: Trial,
) -> None:
    """A timer's period begins when it is made, at time 0 or, if the node was shown one by then, at
    the first one of the recording, which is no multiple of this period."""
    period = 70
    assert BEGIN % (period * 1_000_000) != 0
    digests = set()
    for starts in (0, 1_500):
        parameters = SIM_TIME | {"/ticking/period_ms": period, "/ticking/starts_ms": starts}
        fields = {"stack": {"parameters": parameters}, "record": {"topics": ["/tick"]}}
        command = [*NODE, "single", "Ticking"]
        row = trial.run(trial.spec(command, {"mode": "lockstep"}, **fields))
        assert passed(row), row
        assert len(trial.texts(row, "/tick")) >= MESSAGES * 5 // period - 1
        digests.add(trial.digest(row))
    assert len(digests) == 1


TICKING = [*NODE, "single", "Ticking", "--ros-args", "-p"]
ANSWERING = [*PYTHON, "--ros-args", "-p"]


@pytest.mark.parametrize(
    ("command", "may_differ"),
    [
        ([*TICKING, "wall:=true"], True),
        ([*ANSWERING, "wall_ms:=5"], True),
        ([*TICKING, "wall:=false"], False),
        ([*ANSWERING, "sim_ms:=5"], False),
    ],
    ids=["rclcpp, wall", "rclpy, wall", "rclcpp, simulated", "rclpy, simulated"],
)
def test_who_may_differ_from_run_to_run_is_named(
    trial: Trial, command: list[str], *, may_differ: bool
) -> None:
    fields = {"stack": {"parameters": SIM_TIME}, "record": {"topics": ["/.*"]}}
    row = trial.run(trial.spec(command, {"mode": "lockstep"}, **fields))
    warnings = row["result"]["playback"].get("warnings", [])
    named = [words for words in warnings if "differ" in words]
    assert len(named) == may_differ, warnings
    for words in named:
        assert words.startswith("timers of the machine's clock called back")
        assert "/ticking" in words or "/answering" in words


@pytest.mark.usefixtures("busy")
@pytest.mark.parametrize("executor", ["single", "multi"])
def test_twenty_runs_beside_busy_loops_record_the_same_bytes(trial: Trial, executor: str) -> None:
    command = [*NODE, executor, "Answering", "Passing", "--ros-args"]
    chain = ["-r", "answering:out:=/mid", "-r", "passing:in:=/mid"]
    job = trial.spec(
        [*command, *chain], LOCKSTEP, stack={"parameters": SIM_TIME}, record={"topics": ["/.*"]}
    )
    digests = set()
    for _ in range(20):
        row = trial.run(job)
        assert passed(row), row
        assert len(trial.texts(row)) == MESSAGES
        digests.add(trial.digest(row))
    assert len(digests) == 1


def test_a_callback_that_goes_on_after_its_first_answer_ends_before_the_next_message(
    trial: Trial,
) -> None:
    slow = ["--ros-args", "-p", "work_us:=1000", "-p", "copies:=3"]
    digests = set()
    for _ in range(2):
        command = [*NODE, "single", "Answering", *slow]
        row = trial.run(trial.spec(command, LOCKSTEP))
        assert passed(row), row
        assert ledger_of(row) == (MESSAGES, MESSAGES, 0, "called")
        assert len(trial.texts(row)) == 3 * MESSAGES
        digests.add(trial.digest(row))
    assert len(digests) == 1
