"""How much of a window a truth must be there for, before an error is judged by it."""

from typing import Any

import pytest

from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.finding import Finding
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion
from tests.unit.evaluate.recordings import evidence, number, stamped

METRICS = ["rmse", "max", "final"]
TENTHS = [10 + n / 10 for n in range(100)]
RIGHT = [("/pose", at + 0.01, stamped(at, 0.0, 0.0)) for at in TENTHS]


def wild_from(second: float) -> list[Any]:
    """999 m off from then on."""
    return [("/pose", at + 0.01, stamped(at, 999.0 if at >= second else 0.0, 0.0)) for at in TENTHS]


def truth(*times: float) -> list[Any]:
    return [("/truth", at, stamped(at, 0.0, 0.0)) for at in times]


def found(given: Evidence, **wanted: Any) -> Finding:
    error = {"topic": "/pose", "truth": "/truth", "fields": ["pose.position.x"], "max": 0.3}
    [finding] = evaluate([Criterion.model_validate({"name": "c", "error": error | wanted})], given)
    return finding


@pytest.mark.parametrize("recording", [False, True])
@pytest.mark.parametrize("metric", METRICS)
def test_a_truth_that_is_there_for_a_second_judges_no_ten(metric: str, recording: bool) -> None:
    short, answers = truth(*TENTHS[:10]), wild_from(11)
    given = evidence(answers, short) if recording else evidence(answers + short)
    finding = found(given, metric=metric, recording=recording)
    assert finding.outcome == "invalid"
    assert finding.coverage == pytest.approx(0.1, abs=0.001)
    assert "lower minCoverage" in finding.message
    assert found(given, metric=metric, recording=recording, minCoverage=0.1).outcome == "passed"


@pytest.mark.parametrize("metric", METRICS)
def test_a_truth_whose_stamps_stand_still_is_one_sample(metric: str) -> None:
    still = [("/truth", at, stamped(10 + n % 4 / 10, 0.0, 0.0)) for n, at in enumerate(TENTHS)]
    finding = found(evidence(wild_from(10.4) + still), metric=metric)
    assert finding.outcome == "invalid"
    assert finding.coverage is not None
    assert finding.coverage < 0.05


@pytest.mark.parametrize("metric", METRICS)
def test_a_recorded_truth_of_another_clock_is_there_as_long_as_it_came(metric: str) -> None:
    """Of stamps that stand still there, the first alone counts."""
    for shown, outcome in ((100, "passed"), (10, "invalid")):
        source = [
            ("/truth", at, stamped(500 + min(n, shown - 1) / 10, 0.0, 0.0))
            for n, at in enumerate(TENTHS)
        ]
        answers = [
            ("/pose", at + 0.01, stamped(500 + min(n, shown - 1) / 10, 0.0, 0.0))
            for n, at in enumerate(TENTHS)
        ]
        finding = found(evidence(answers, source), metric=metric, recording=True)
        assert finding.outcome == outcome, finding


@pytest.mark.parametrize("metric", ["rmse", "max"])
def test_the_truth_at_one_time_is_no_error_over_time(metric: str) -> None:
    once = truth(10.0)
    finding = found(evidence(wild_from(10.2) + once), metric=metric, minCoverage=0)
    assert (finding.outcome, finding.figure) == ("invalid", None)
    twice = [("/pose", 10.02, stamped(10.01, 0.0, 0.0))]
    finding = found(evidence(wild_from(10.2) + once + twice), metric=metric, minCoverage=0)
    assert finding.outcome == "invalid"
    assert "pairs are with the truth at one time" in finding.message
    assert "write `metric: final`" in finding.message
    # What was seen out of its bounds was, however seldom the truth came.
    wrong = [("/pose", 10.02, stamped(10.01, 7.0, 0.0))]
    finding = found(evidence(wild_from(10.2) + once + wrong), metric=metric, minCoverage=0)
    assert (finding.outcome, finding.figure is not None) == ("failed", True)


def test_one_truth_near_the_end_is_enough_for_the_last_error() -> None:
    for at, outcome in ((19.5, "passed"), (19.0, "passed"), (15.0, "invalid")):
        finding = found(evidence(RIGHT + truth(at)), metric="final")
        assert finding.outcome == outcome, finding
    assert "write" not in finding.message
    assert "the truth must be there throughout" in finding.message
    assert found(evidence(RIGHT + truth(15)), metric="final", minCoverage=0.5).outcome == "passed"


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("step", [0.1, 0.5, 1.0, 2.5, 3.3])
def test_a_truth_that_comes_all_the_time_is_enough_however_slow(metric: str, step: float) -> None:
    for begin in (10.0, 10 + step / 3):
        times = [begin + n * step for n in range(int((20 - begin) / step) + 1)]
        answers = [("/pose", at + 0.01, stamped(at, 0.0, 0.0)) for at in times]
        given = evidence(answers + truth(*[at for at in times if at < 20]))
        assert found(given, metric=metric).outcome == "passed", (begin, found(given, metric=metric))


@pytest.mark.parametrize("metric", METRICS)
def test_keyframes_too_rare_for_a_window_say_what_to_write(metric: str) -> None:
    given = evidence(RIGHT + truth(12.0, 17.0))
    assert (
        "of one that is sparse on purpose lower minCoverage" in found(given, metric=metric).message
    )
    assert found(given, metric=metric, minCoverage=0.4).outcome == "passed"


@pytest.mark.parametrize("metric", METRICS)
def test_a_gap_of_the_recording_itself_is_none_of_the_truth(metric: str) -> None:
    both = {"within": [*TENTHS[:30], *TENTHS[70:]], "at the end": TENTHS[:60]}
    for where, inputs in both.items():
        answers = [("/pose", at + 0.01, stamped(at, 0.0, 0.0)) for at in inputs]
        times = [round(at * 1e9) for at in inputs]
        given = evidence(answers, truth(*inputs), inputs=lambda times=times: times)
        finding = found(given, metric=metric, recording=True)
        assert finding.outcome == "passed", where
        assert finding.coverage == pytest.approx(1, abs=0.03), where
        # Where inputs came, and no truth, nothing is forgiven.
        given = evidence(RIGHT, truth(*inputs))
        if metric != "final" or where == "at the end":
            assert found(given, metric=metric, recording=True).outcome == "invalid", where


def delayed(
    recording: bool, *more: float, late: float = 0.35, step: float = 0.1, shown: int = 30
) -> Evidence:
    """In 3 s a truth is stamped so long before it comes, and so are answers; more of them are wild.

    A third of a second is more than a tenth of such a window.
    """
    came = [10.01 + n / 10 for n in range(shown)]
    messages = [stamped(10.01 + n * step - late, 0.0, 0.0) for n in range(shown)]
    source = [("/truth", *each) for each in zip(came, messages, strict=True)]
    answers = [("/pose", at + 0.04, message) for _, at, message in source]
    answers += [("/pose", 12.99, stamped(at, 999.0, 0.0)) for at in more]
    return evidence(answers + ([] if recording else source), source, end=13)


@pytest.mark.parametrize("recording", [False, True])
@pytest.mark.parametrize("metric", METRICS)
def test_a_truth_that_is_stamped_a_while_before_it_comes_is_there_all_the_time(
    metric: str, recording: bool
) -> None:
    for late, least in ((0.0, 0.99), (0.3, 0.99), (0.35, 0.98)):
        finding = found(delayed(recording, late=late), metric=metric, recording=recording)
        assert finding.outcome == "passed", finding
        assert finding.coverage is not None
        assert finding.coverage > least


@pytest.mark.parametrize("recording", [False, True])
@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize(
    "given", [{"shown": 20}, {"step": 0.03, "late": 0.0}, {"shown": 1, "late": 1.0}]
)
def test_a_truth_that_ends_or_whose_stamps_are_too_slow_is_not_there_for_it(
    metric: str, recording: bool, given: dict[str, Any]
) -> None:
    finding = found(delayed(recording, **given), metric=metric, recording=recording)
    assert finding.outcome == "invalid", finding


@pytest.mark.parametrize("metric", METRICS)
def test_a_truth_that_ends_with_its_answers_is_not_there_behind_it_however_late_it_comes(
    metric: str,
) -> None:
    def both(begin: int, end: int, late: float) -> Finding:
        stamps = [10 + n / 10 for n in range(begin, end)]
        given = [(topic, at + late, stamped(at, 0.0, 0.0))
                 for topic in ("/pose", "/truth") for at in stamps]  # fmt: skip
        return found(evidence(given), metric=metric)

    def covers(finding: Finding, share: float) -> bool:
        return finding.coverage == pytest.approx(share, abs=0.021)

    for late in (1.2, 5.0):
        finding = both(0, 50, late)
        assert finding.outcome == "invalid"
        assert covers(finding, 0.5)
    for begin, covered in ((-8, 0.58), (-20, 0.6)):
        finding = both(begin, 50, 1.2)
        assert finding.outcome == "invalid"
        assert covers(finding, covered)
    # Nor does it begin later for that.
    finding = both(6, 91, 1.2)
    assert finding.outcome == "passed"
    assert covers(finding, 0.92)


@pytest.mark.parametrize("recording", [False, True])
@pytest.mark.parametrize("metric", METRICS)
def test_behind_the_last_stamp_of_a_truth_nothing_is_judged_however_late_it_came(
    metric: str, recording: bool
) -> None:
    finding = found(delayed(recording, 12.9), metric=metric, recording=recording)
    assert finding.outcome == "invalid", finding
    # Such as a goal of the drive's begin that comes late.
    goal = [("/truth", 19.5, stamped(10.0, 0.0, 0.0))]
    finding = found(evidence(wild_from(11) + goal), metric=metric, minCoverage=0.5)
    assert finding.outcome == "invalid", finding


@pytest.mark.parametrize("metric", METRICS)
def test_a_truth_of_a_slow_stack_is_there_when_its_stamps_are(metric: str) -> None:
    stamps = [10.01 + n / 10 for n in range(30)]
    recorded = [(topic, at + 0.7, stamped(at, 0.0, 0.0))
                for topic in ("/pose", "/truth") for at in stamps]  # fmt: skip
    finding = found(evidence(recorded, end=13), metric=metric)
    assert finding.outcome == "passed"
    assert finding.coverage == pytest.approx(1, abs=0.005)


def test_mode_max_leaves_open_when_a_truth_without_a_stamp_was_there() -> None:
    """All come at the end, as bag time runs ahead of the stack."""
    recorded = [(topic, 19.5 + n / 1000, number(1.0)) for topic in ("/a", "/b") for n in range(90)]
    wanted = {"topic": "/a", "truth": "/b", "fields": ["data"]}
    unknown = found(evidence(recorded, paced=False), **wanted)
    assert (unknown.outcome, unknown.coverage) == ("invalid", None)
    assert "mode max leaves open when messages on /a were published" in unknown.message
    assert "lower minCoverage" in found(evidence(recorded), **wanted).message
