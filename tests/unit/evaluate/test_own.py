"""A user's own evaluator: its answers, its faults, and what it can't reach."""

import os
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from bagpipe.evaluate.courses import with_courses
from bagpipe.evaluate.finding import Finding, NoEvidenceError, as_expected
from bagpipe.evaluate.model import Criterion, OwnEvaluator
from bagpipe.evaluate.own import own
from tests.unit.evaluate.recordings import evidence, number, stamped


def run(
    tmp_path: Path, program: str, timeout: str = "120s", entries: list[Any] | None = None
) -> Finding:
    folder = tmp_path / "lane"
    folder.mkdir(exist_ok=True)
    (folder / "evaluator.py").write_text(program)
    wanted = OwnEvaluator(config_map="lane", timeout=timeout)
    given = evidence(entries or [("/out", 11.0, number(3.0))], values={"speed": 2})
    return own("lane", wanted, given, tmp_path)


def test_it_reads_the_recording_and_answers_with_a_figure(tmp_path: Path) -> None:
    finding = run(
        tmp_path,
        "def evaluate(case):\n"
        "    print('hello')\n"
        "    [(time, message)] = case.messages('/out')\n"
        "    assert case.messages('/none') == [] and case.topics == ['/out']\n"
        "    figure = message.data * case.values['speed']\n"
        "    return {'outcome': 'failed', 'figure': figure, 'unit': 'm', 'message': 'too far',\n"
        "            'direction': 'lower'}\n",
    )
    assert finding == Finding("lane", "own", "failed", 6.0, "m", "", "lower", "too far")


def test_it_may_say_how_its_figure_went(tmp_path: Path) -> None:
    program = (
        "def evaluate(case):\n"
        "    points = [(t, m.data) for t, m in case.messages('/out')] + [(case.start, 2 ** 0.5)]\n"
        "    points.append((case.end, float('nan')))\n"
        "    course = {'points': points, 'label': 'l', 'unit': 'm', 'high': 2}\n"
        "    return {'outcome': 'passed', 'course': course}\n"
    )
    found = run(tmp_path, program)
    wanted = Criterion.model_validate({"name": "lane", "own": {"configMap": "lane"}})
    [shown] = with_courses([wanted], [found], evidence([]))
    assert shown.course == {
        "label": "l", "unit": "m", "low": None, "high": 2.0,
        "points": [[0.0, 1.4142], [1.0, 3.0]], "odd": [10.0],
    }  # fmt: skip
    [none] = with_courses([wanted], [Finding("lane", "own", "passed")], evidence([]))
    assert none.course is None


@pytest.mark.parametrize(
    "course",
    [
        "7", "{}", "{'points': 7}", "{'points': [1]}", "{'points': [(1, 2, 3)]}",
        "{'points': [('1', 2)]}", "{'points': [(float('nan'), 2)]}", "{'points': [(2 ** 63, 2)]}",
        "{'points': [(-1, 2)]}", "{'points': [(1, 10 ** 400)]}", "{'points': [(1, True)]}",
        "{'points': [], 'low': float('inf')}", "{'points': [], 'high': 'x'}",
    ],
)  # fmt: skip
def test_a_course_that_is_none_is_no_evidence(tmp_path: Path, course: str) -> None:
    program = f"def evaluate(case):\n    return {{'outcome': 'passed', 'course': {course}}}\n"
    with pytest.raises(NoEvidenceError, match=r"the evaluator's (course|high)"):
        run(tmp_path, program)


@pytest.mark.parametrize("figure", ["float('nan')", "float('inf')", "10 ** 400"])
def test_a_figure_that_is_no_number_fails(tmp_path: Path, figure: str) -> None:
    program = f"def evaluate(case):\n    return {{'outcome': 'passed', 'figure': {figure}}}\n"
    finding = run(tmp_path, program)
    assert (finding.outcome, finding.figure) == ("failed", None)
    assert finding.message.startswith("the evaluator's figure is no finite number but ")
    assert as_expected(finding).outcome == "failed"


@pytest.mark.parametrize(
    ("share", "outcome"), [("0.95", "passed"), ("0.5", "invalid"), ("None", "passed")]
)
def test_it_may_say_how_much_it_has_seen(tmp_path: Path, share: str, outcome: str) -> None:
    program = (
        "def evaluate(case):\n"
        f"    return {{'outcome': 'passed', 'coverage': {share}, 'covered': 'of the curves'}}\n"
    )
    finding = run(tmp_path, program)
    assert (finding.outcome, finding.covered) == (outcome, "of the curves")
    assert finding.coverage == (None if share == "None" else float(share))


def test_halves_of_characters_in_its_words_can_be_written_all_the_same(tmp_path: Path) -> None:
    program = "def evaluate(case): return {'outcome': 'failed', 'message': 'at \\ud800 s'}"
    finding = run(tmp_path, program)
    assert (finding.outcome, finding.message) == ("failed", "at ? s")


def test_it_gets_what_belongs_to_the_window(tmp_path: Path) -> None:
    """Of what came after the window's end that which is stamped in it."""
    program = (
        "def evaluate(case):\n"
        "    times = [round(time / 1e9, 1) for time, _ in case.messages('/pose')]\n"
        "    return {'outcome': 'passed', 'message': str(times)}\n"
    )
    entries = [("/pose", at, stamped(s, 0, 0)) for at, s in ((19, 19), (21, 19.5), (22, 21))]
    assert run(tmp_path, program, entries=entries).message == "[19.0, 21.0]"


def test_a_boolean_will_do(tmp_path: Path) -> None:
    assert run(tmp_path, "def evaluate(case):\n    return True\n").outcome == "passed"


@pytest.mark.parametrize(
    ("program", "sentence"),
    [
        ("def evaluate(case):\n    return 1 / 0\n", "ZeroDivisionError"),
        ("def other(case):\n    return True\n", "has no function evaluate"),
        ("def evaluate(case:\n", "SyntaxError"),
        ("def evaluate(case):\n    return 7\n", "answered int and no map"),
        ("def evaluate(case):\n    return {'outcome': 'fine'}\n", "outcome is 'fine'"),
        (
            "def evaluate(case):\n    return {'outcome': 'passed', 'figure': 'x'}\n",
            "figure is no number",
        ),
        ("def evaluate(case):\n    return {'outcome': 'passed', 'm': 'x' * 70000}\n", "no answer"),
        ("def evaluate(case):\n    return {'outcome': 'Passed'}\n", "outcome is 'Passed'"),
        (
            "def evaluate(case):\n    return {'outcome': 'passed', 'direction': 'up'}\n",
            "direction is 'up': return lower or higher",
        ),
        (
            "def evaluate(case):\n    return {'outcome': 'passed', 'coverage': 95}\n",
            "coverage is 95: return a share from 0 to 1",
        ),
        ("import os\ndef evaluate(case):\n    os._exit(3)\n", "ended with status 3"),
    ],
)
def test_a_fault_is_no_pass(tmp_path: Path, program: str, sentence: str) -> None:
    with pytest.raises(NoEvidenceError) as refused:
        run(tmp_path, program)
    assert sentence in str(refused.value)


def test_one_that_hangs_is_ended_with_what_it_started(tmp_path: Path) -> None:
    program = (
        "import pathlib, subprocess, time\n"
        "def evaluate(case):\n"
        "    child = subprocess.Popen(['sleep', '600'])\n"
        f"    pathlib.Path({str(tmp_path / 'child')!r}).write_text(str(child.pid))\n"
        "    time.sleep(600)\n"
    )
    for timeout in ("8s", "32s", "128s"):  # a slow machine needs longer to get so far
        with pytest.raises(NoEvidenceError, match=f"did not answer within {timeout}"):
            run(tmp_path, program, timeout=timeout)
        if (tmp_path / "child").exists():
            break
    child = int((tmp_path / "child").read_text())
    deadline, pause = time.monotonic() + 60, threading.Event()
    while runs(child):  # a kill takes its moment
        assert time.monotonic() < deadline, "what it started still runs"
        pause.wait(0.02)


def runs(process: int) -> bool:
    try:
        return "Z (zombie)" not in Path(f"/proc/{process}/status").read_text()
    except OSError:
        return False


def test_it_sees_no_secret_of_the_worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "hidden")
    program = (
        "import os\n"
        "def evaluate(case):\n"
        "    return {'outcome': 'passed', 'message': ','.join(sorted(os.environ))}\n"
    )
    names = run(tmp_path, program).message.split(",")
    assert "AWS_SECRET_ACCESS_KEY" not in names
    assert set(names) <= {"PATH", "LC_CTYPE"}
    assert "AWS_SECRET_ACCESS_KEY" in os.environ


def test_a_missing_key_is_reported(tmp_path: Path) -> None:
    with pytest.raises(NoEvidenceError, match=r"ConfigMap lane has no key evaluator\.py"):
        own("lane", OwnEvaluator(config_map="lane"), evidence([]), tmp_path)
