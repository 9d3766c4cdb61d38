"""What the answer of a user's own evaluator comes to, without its process."""

from pathlib import Path
from typing import Any

import pytest

from bagpipe.evaluate import own as own_module
from bagpipe.evaluate.finding import Finding, NoEvidenceError
from bagpipe.evaluate.model import OwnEvaluator
from bagpipe.evaluate.own import own
from tests.unit.evaluate.recordings import evidence


@pytest.fixture
def judged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    (tmp_path / "lane").mkdir()
    (tmp_path / "lane/evaluator.py").touch()

    def judge(least: float = 0.9, **answer: Any) -> Finding:
        given = {"outcome": "passed"} | answer
        monkeypatch.setattr(own_module, "_answered", lambda *_: given)
        wanted = OwnEvaluator(config_map="lane", min_coverage=least)
        return own("lane", wanted, evidence([]), tmp_path)

    return judge


def test_an_answer_of_a_word_alone_is_a_finding_without_a_figure(judged: Any) -> None:
    for word in ("passed", "failed", "invalid"):
        assert judged(outcome=word) == Finding("lane", "own", word)
    odd: list[Any] = ["fine", None, ["passed"], {"passed": 1}, "Passed"]
    for other in odd:
        with pytest.raises(NoEvidenceError, match="return passed, failed or invalid"):
            judged(outcome=other)


def test_an_answer_may_have_a_figure_its_unit_limit_direction_and_words(judged: Any) -> None:
    finding = judged(
        figure=3, unit="m", limit="at most 2 m", direction="lower", message="too far", odd=1
    )
    assert finding == Finding("lane", "own", "passed", 3.0, "m", "at most 2 m", "lower", "too far")
    assert judged(direction="higher", figure=-0.5).figure == -0.5
    for direction in ("up", None, 1, ["lower"]):
        with pytest.raises(NoEvidenceError, match="return lower or higher"):
            judged(direction=direction)


def test_each_text_is_bounded(judged: Any) -> None:
    long = "x" * 1001
    finding = judged(unit=long, limit=long, message=long, covered=long)
    texts = (finding.unit, finding.limit, finding.message, finding.covered)
    assert [len(text) for text in texts] == [32, 200, 1000, 200]
    with pytest.raises(NoEvidenceError) as refused:
        judged(outcome="y" * 101)
    assert f"outcome is '{'y' * 100}':" in str(refused.value)
    with pytest.raises(NoEvidenceError) as refused:
        judged(direction="y" * 101)
    assert f"direction is '{'y' * 100}':" in str(refused.value)


@pytest.mark.parametrize("figure", [float("nan"), float("inf"), -(10**400), 10**400])
def test_a_figure_beyond_all_numbers_fails_unless_the_answer_is_a_doubt(
    judged: Any, figure: float
) -> None:
    for word in ("passed", "failed"):
        finding = judged(outcome=word, figure=figure)
        assert (finding.outcome, finding.figure, finding.instead) == ("failed", None, "failed")
        assert finding.message.startswith("the evaluator's figure is no finite number but ")
    assert judged(outcome="invalid", figure=figure, message="why").message == "why"


@pytest.mark.parametrize("key", ["figure", "coverage"])
@pytest.mark.parametrize("value", [True, "3", [3]])
def test_what_is_no_number_is_no_evidence(judged: Any, key: str, value: object) -> None:
    with pytest.raises(NoEvidenceError, match=f"the evaluator's {key} is no number"):
        judged(**{key: value})


@pytest.mark.parametrize(
    ("share", "least", "outcome"),
    [(0, 0.0, "passed"), (1, 1.0, "passed"), (0.9, 0.9, "passed"), (0.899, 0.9, "invalid")],
)
def test_a_share_from_nothing_to_all_is_held_to_the_least(
    judged: Any, share: float, least: float, outcome: str
) -> None:
    finding = judged(least, coverage=share)
    assert (finding.outcome, finding.coverage) == (outcome, share)
    assert (finding.covered, finding.clock) == ("what the evaluator says", "none")
    assert judged(least, coverage=share, covered="the curves").covered == "the curves"


def test_a_share_that_is_none_is_refused_and_no_share_is_asked_for_nothing(judged: Any) -> None:
    for share in (-0.001, 1.001, 95, float("nan"), 10**400):
        with pytest.raises(NoEvidenceError, match="return a share from 0 to 1"):
            judged(coverage=share)
    finding = judged(1.0, covered="two laps")
    assert (finding.outcome, finding.coverage, finding.covered) == ("passed", None, "two laps")
