"""A user's own evaluator: its answers, its faults, and what it can't reach."""

import os
import threading
import time
from pathlib import Path

import pytest

from bagpipe.evaluate.finding import Finding, NoEvidenceError
from bagpipe.evaluate.model import OwnEvaluator
from bagpipe.evaluate.own import own
from tests.unit.evaluate.recordings import evidence, number


def run(tmp_path: Path, program: str, timeout: str = "120s") -> Finding:
    folder = tmp_path / "lane"
    folder.mkdir(exist_ok=True)
    (folder / "evaluator.py").write_text(program)
    wanted = OwnEvaluator(config_map="lane", timeout=timeout)
    given = evidence([("/out", 11.0, number(3.0))], values={"speed": 2})
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


def test_a_missing_key_is_told(tmp_path: Path) -> None:
    with pytest.raises(NoEvidenceError, match=r"ConfigMap lane has no key evaluator\.py"):
        own("lane", OwnEvaluator(config_map="lane"), evidence([]), tmp_path)
