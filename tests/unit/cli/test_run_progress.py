"""How `bagpipe run` says where it is: rates and times left, on a terminal and in a log."""

import io
from typing import Any

import pytest
from rich.console import Console

from bagpipe.cli.pace import Pace, done_of, line
from bagpipe.cli.showing import Showing


def progress(
    passed: int = 0, planned: int = 100, phase: str = "Running", **more: Any
) -> dict[str, Any]:
    counts = {"planned": planned, "running": 2, "passed": passed, "failed": 0, "invalid": 0}
    return {"phase": phase, "warning": "", "cases": counts | {"errored": 0, "discarded": 0}} | more


def paced(*looks: tuple[float, int]) -> Pace:
    pace = Pace()
    for now, done in looks:
        pace.look(now, done)
    return pace


@pytest.mark.parametrize(
    ("looks", "text"),
    [
        ([(0, 0)], "10 of 100 cases (10 passed), 2 running"),
        ([(0, 0), (20, 10)], "30.0 a minute, about 3 min 00 s left"),
        ([(0, 0), (5, 10)], "2.0 a second, about 45 s left"),
        ([(0, 0), (30, 0), (1000, 10)], "0.6 a minute, about 2 h 25 min left"),
        # The hour before the last minute does not count.
        ([(0, 0), (3600, 4), (3630, 7), (3660, 10)], "6.0 a minute, about 15 min 00 s left"),
    ],
)
def test_the_rate_is_of_the_last_minute(looks: list[tuple[float, int]], text: str) -> None:
    assert line(progress(10), paced(*looks)).endswith(text)


def test_a_job_that_is_over_at_the_first_look_has_no_rate() -> None:
    assert line(progress(2, 2, "Complete"), Pace()) == "2 of 2 cases (2 passed)"


def test_looks_are_bounded() -> None:
    pace = paced(*((second / 2, second) for second in range(10_000)))
    assert len(pace._looks) <= 122
    assert pace.rate == pytest.approx(2)


def test_the_last_line_has_all_outcomes_and_nothing_left() -> None:
    ended = progress(3, 6, "Complete", warning="the volume is full")
    ended["cases"] |= {"failed": 1, "invalid": 1, "errored": 1, "running": 0}
    assert done_of(ended) == 6
    assert line(ended, paced((0, 0), (6, 6))) == (
        "6 of 6 cases (3 passed, 1 failed, 1 invalid, 1 errored), 1.0 a second, the volume is full"
    )


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_a_log_gets_a_line_every_few_seconds_and_the_last_one() -> None:
    stream, clock = io.StringIO(), Clock()
    with Showing(Console(file=stream), 2, clock=clock) as showing:
        showing.show(progress(phase="Planning", planned=0))
        for count in range(13):
            showing.show(progress(count, 13))
            showing.show(progress(count, 13))
            clock.now += 1
        showing.show(progress(13, 13, "Complete"))
        clock.now += 10
        showing.show(progress(13, 13, "Complete"))
    lines = stream.getvalue().splitlines()
    assert lines[:2] == [
        "starting 2 slots",
        "planning: reading the recordings' indexes",
    ]
    assert [text.split(" cases")[0] for text in lines[2:]] == ["5 of 13", "10 of 13", "13 of 13"]


def test_a_terminal_has_one_line_that_changes() -> None:
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=True, width=200)
    with Showing(console, 2) as showing:
        showing.show(progress(1))
        console.print("")
    text = stream.getvalue()
    assert "1 of 100 cases (1 passed), 2 running" in text
    assert "\x1b[?25h" in text  # the cursor is shown again
