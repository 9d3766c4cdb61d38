"""Following a job to its end, through whatever a connection does."""

from typing import Any

import click
import pytest
from rich.console import Console

from bagpipe.cli.cluster.faults import ClusterError
from bagpipe.cli.cluster.following import PATIENCE_SECONDS, TimedOutError, states
from bagpipe.cli.cluster.state import JobState
from bagpipe.cli.cluster.watching import followed, show_end
from tests.unit.cli.cluster_objects import Answer, FakeClock, FaultySource, a_job, ended, running

AWAY = ClusterError("the cluster does not answer", passing=True)


def phases(source: FaultySource, clock: FakeClock, seconds: float = 3600) -> list[str]:
    return [state.phase for state in states(source, "nightly", seconds, clock.times)]


def test_a_job_is_followed_over_its_watch() -> None:
    source = FaultySource([a_job(version="7")], [[("MODIFIED", running()), ("MODIFIED", ended())]])
    assert phases(source, FakeClock()) == ["Pending", "Running", "Complete"]
    assert source.asked == ["get", "watch from 7"]


def test_a_job_that_has_ended_needs_no_watch() -> None:
    source = FaultySource([ended("Failed")])
    assert phases(source, FakeClock()) == ["Complete"]
    assert source.asked == ["get"]


def test_a_watch_that_ends_is_begun_again_and_repeats_nothing() -> None:
    source = FaultySource([running(), running(), ended()], [[], []])
    clock = FakeClock()
    assert phases(source, clock) == ["Running", "Complete"]
    assert source.asked == ["get", "watch from 1", "get", "watch from 1", "get"]
    assert clock.pauses == [1, 1]


def test_a_server_that_is_away_for_a_while_is_waited_for() -> None:
    gone = ClusterError("too old", status=410, passing=True)
    source = FaultySource([running(), AWAY, AWAY, AWAY, running(), ended()], [[AWAY], [gone]])
    clock = FakeClock()
    assert phases(source, clock) == ["Running", "Complete"]
    assert clock.pauses == [1, 2, 4, 8, 1]


def test_a_server_that_stays_away_is_given_up() -> None:
    clock = FakeClock()
    with pytest.raises(ClusterError, match="asked for 120 s; the job goes on without us"):
        phases(FaultySource([running(), AWAY]), clock)
    assert PATIENCE_SECONDS < clock.seconds < PATIENCE_SECONDS + 20
    assert max(clock.pauses) == 10


@pytest.mark.parametrize("status", [401, 403, 404])
def test_a_permanent_fault_is_reported_at_once(status: int) -> None:
    clock = FakeClock()
    with pytest.raises(ClusterError, match="no such thing"):
        phases(FaultySource([ClusterError("no such thing", status=status)]), clock)
    assert clock.seconds == 0


def test_a_deleted_job_is_reported_with_its_results() -> None:
    job = running()
    job["status"]["results"] = "s3://r/nightly"
    with pytest.raises(ClusterError, match=r"was deleted before it had ended.*s3://r/nightly"):
        phases(FaultySource([running()], [[("DELETED", job)]]), FakeClock())


def test_a_job_that_is_deleted_while_nobody_looks() -> None:
    missing = ClusterError("there is no job nightly", status=404)
    with pytest.raises(ClusterError, match="was deleted before it had ended"):
        phases(FaultySource([running(), missing], [[]]), FakeClock())


def test_another_job_of_the_same_name_is_not_the_job() -> None:
    other = a_job(uid="uid-2")
    with pytest.raises(ClusterError, match="was deleted"):
        phases(FaultySource([running(), other], [[]]), FakeClock())


def test_the_time_that_is_allowed_bounds_it() -> None:
    clock = FakeClock()
    with pytest.raises(TimedOutError, match=r"has not ended within 30 s.*it is Running") as error:
        phases(FaultySource([running()]), clock, 30)
    assert (clock.seconds, error.value.exit_code) == (30, 2)


@pytest.mark.parametrize(
    ("program", "given", "message", "expected"),
    [
        ("bagpipe", {}, "Cases are running.", "running. Follow it with `bagpipe watch nightly -n"),
        ("bagpipe", {}, "of 4", ": of 4. Follow it with `bagpipe watch nightly -n robots`, or"),
        (
            "kubectl bagpipe",
            {},
            "",
            "Running. Follow it with `kubectl bagpipe watch nightly -n robots`",
        ),
        ("bagpipe", {"context": "my lab"}, "", "watch nightly -n robots --context 'my lab'`, or"),
    ],
)
def test_the_hint_can_be_copied(
    program: str, given: dict[str, str], message: str, expected: str
) -> None:
    job = running()
    job["status"]["conditions"][1]["message"] = message
    with click.Context(click.Command("watch"), info_name=program) as context:
        context.params.update(given)
        with pytest.raises(TimedOutError) as error:
            phases(FaultySource([job]), FakeClock(), 30)
    assert expected in error.value.message


@pytest.mark.parametrize(
    ("looks", "given", "expected"),
    [
        ([running()], {"context": "lab"}, "goes on: bagpipe watch nightly -n robots --context lab"),
        ([], {"namespace": "robots"}, "goes on: bagpipe watch nightly -n robots\n"),
    ],
)
def test_the_hint_of_ctrl_c_can_be_copied(
    looks: list[Answer],
    given: dict[str, str],
    expected: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    class Silent(FaultySource):
        def job(self, _name: str) -> dict[str, Any]:
            raise KeyboardInterrupt

    source = FaultySource(looks, [[interrupted]]) if looks else Silent([])
    with click.Context(click.Command("watch"), info_name="bagpipe") as context:
        context.params.update(given)
        with pytest.raises(SystemExit) as ended:
            followed(source, "nightly", 30, Console(stderr=True))
    assert (ended.value.code, expected in capsys.readouterr().err) == (130, True)


def test_the_hints_at_a_job_s_end_can_be_copied(capsys: pytest.CaptureFixture[str]) -> None:
    with click.Context(click.Command("watch"), info_name="kubectl bagpipe") as context:
        context.params["context"] = "lab"
        show_end(JobState.of(ended("Failed")), Console(width=40))
        show_end(JobState.of(ended("")), Console(width=40))
    expected = capsys.readouterr().out
    place = "-n robots --context lab"
    assert f"why: kubectl bagpipe results job/nightly {place} --failed\n" in expected
    assert f"why: kubectl bagpipe logs nightly {place}\n" in expected


def test_the_time_bounds_a_watch_full_of_news() -> None:
    clock = FakeClock()
    news = [("MODIFIED", running(passed=n)) for n in range(4)]
    source = FaultySource([a_job()], [[news[0], lambda: clock.pause(40), *news[1:]]])
    with pytest.raises(TimedOutError):
        phases(source, clock, 30)
