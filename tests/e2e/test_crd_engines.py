"""What each engine of a stack takes, as the API server says it: other fields, other sources."""

from typing import Any

import pytest

from tests.e2e.test_crd_refusals import (
    GOOD,
    Manifest,
    crd,  # noqa: F401  the fixture sees to the CRD in this module too
    dry_run,
    without,
)

pytestmark = pytest.mark.e2e

PROGRAM = {"image": "example/traffic:1", "command": ["simulate"], "engine": "exec"}
EXEC: Manifest = GOOD | {
    "spec": {
        "source": {"files": ["pvc://scenarios/*.json"]},
        "stack": PROGRAM,
        "output": {"uri": "pvc://results/traffic"},
    }
}
# Each is the spec above, which is good, with these parts replaced.
EXEC_REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "files without the engine": (
        {"stack": {"image": "i", "command": ["c"]}, "record": {"topics": ["/tf"]}},
        "source.files are for stack.engine: exec, which reads files of any kind: write that",
    ),
    "neither bags nor files": ({"source": {}}, "source needs one of bags, sequence, files and"),
    "both bags and files": (
        {"source": {"bags": ["pvc://a/a.bag"], "files": ["pvc://a/a.json"]}},
        "source needs one of bags, sequence, files and simulator: write for",
    ),
    "no files": ({"source": {"files": []}}, "source.files must name at least one file: write"),
    "files and topics": (
        {"source": {"files": ["pvc://a/a"], "topics": ["/tf"]}}, "write only source.files",
    ),
    "unknown scheme": (
        {"source": {"files": ["/a"]}}, "this file's URI has no known scheme: write pvc://",
    ),
    "outside its volume": (
        {"source": {"files": ["pvc://a/../b"]}}, "a file's path must stay in its volume",
    ),
    "output is a source": (
        {"output": {"uri": "pvc://scenarios/*.json/x"}}, "would overwrite it: write a folder",
    ),
    "output below a wildcard": (
        {"source": {"files": ["pvc://results/**/*.json"]}}, "lies below a ** of source.files",
    ),
    "a record": ({"record": {"topics": ["/tf"]}}, "are kept: write no record"),
    "parameters": ({"stack": PROGRAM | {"parameters": {"/a": 1}}}, "write stack.env, or words of"),
    "remap": ({"stack": PROGRAM | {"remap": {"/a": "/b"}}}, "write stack.env, or words of"),
    "a mode": ({"playback": {"mode": "max"}}, "write only playback.caseTimeout"),
    "a rate": ({"playback": {"rate": 2.0}}, "write only playback.caseTimeout"),
    "steps": (
        {"playback": {"mode": "lockstep", "steps": [{"trigger": "/a", "answer": "/b"}]}},
        "write only playback.caseTimeout",
    ),
    "another engine": ({"stack": PROGRAM | {"engine": "ros2"}}, 'supported values: "ros1", "exec"'),
}  # fmt: skip


def exec_job(parts: dict[str, Any]) -> Manifest:
    return EXEC | {"spec": EXEC["spec"] | parts}


@pytest.mark.parametrize("case", EXEC_REFUSED)
def test_what_has_no_meaning_for_an_engine_is_refused(case: str) -> None:
    parts, sentence = EXEC_REFUSED[case]
    answer = dry_run(exec_job(parts))
    assert answer.returncode == 1
    assert sentence in answer.stderr


@pytest.mark.parametrize(
    "parts", [{}, {"source": {"bags": ["pvc://a/a.bag"]}, "playback": {"caseTimeout": "1m"}}]
)
def test_a_program_takes_files_or_bags(parts: dict[str, Any]) -> None:
    answer = dry_run(exec_job(parts))
    assert answer.returncode == 0, answer.stderr


def test_only_the_exec_engine_goes_without_a_record() -> None:
    answer = dry_run(without("spec.record"))
    assert answer.returncode == 1
    assert "record is missing, and only stack.engine: exec goes without it: write" in answer.stderr
