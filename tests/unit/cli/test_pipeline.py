"""The CI's step ends as `bagpipe submit` does; tests/integration/control_plane has a real cluster.

In place of the program stand some lines of shell.
"""

from pathlib import Path
from typing import Any

import pytest

from tests.unit.cli import pipeline


def job() -> dict[str, Any]:
    return {"kind": "SimulationJob", "spec": {"stack": {}}}


def program(submit: str) -> str:
    """Notes with which words it is called, and submits in this way."""
    return f'echo "$@" >> words\ncase $1 in submit) cat > submitted; {submit};; esac'


@pytest.mark.parametrize("status", [0, 1])
def test_a_verdict_is_passed_on_and_its_results_are_read(tmp_path: Path, status: int) -> None:
    submit = f"""echo '{{"name": "lane-x7k2p"}}'; exit {status}"""
    ended = pipeline.step(tmp_path, job(), "lanes", program(submit))
    assert (ended.returncode, ended.stderr) == (status, "")
    assert pipeline.IMAGE in (tmp_path / "submitted").read_text()
    submitted, results, report = (tmp_path / "words").read_text().splitlines()
    assert submitted.startswith("submit - -n lanes --generate-name --wait ")
    assert results == "results lane-x7k2p -n lanes --junit junit.xml"
    assert report == "report lane-x7k2p -n lanes --to report.html"


@pytest.mark.parametrize("why", ["job lane is refused", "lane has not ended within 30 m"])
def test_without_a_state_the_program_s_own_word_is_all(tmp_path: Path, why: str) -> None:
    ended = pipeline.step(tmp_path, job(), "lanes", program(f"echo 'Error: {why}' >&2; exit 2"))
    assert (ended.returncode, ended.stdout, ended.stderr) == (2, "", f"Error: {why}\n")
    assert len((tmp_path / "words").read_text().splitlines()) == 1
