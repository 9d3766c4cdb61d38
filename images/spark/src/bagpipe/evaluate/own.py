"""A user's own evaluator: a Python function in a process of its own, with bounds and no secrets.

The process gets no environment but PATH, so that it can't read the credentials of storage; it
is as wide as its container otherwise, which has no right in the cluster.
"""

import json
import math
import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.finding import Finding, NoEvidenceError, covering
from bagpipe.evaluate.model import OwnEvaluator
from bagpipe.texts import duration_seconds

# Where the operator mounts the ConfigMaps that criteria name, in the executors alone.
EVALUATORS = Path("/etc/bagpipe/evaluators")
_LONGEST_ANSWER = 64 * 1024
_LATEST = 1 << 63


def own(name: str, wanted: OwnEvaluator, evidence: Evidence, folder: Path = EVALUATORS) -> Finding:
    """What the user's function answers. Raises NoEvidenceError where it gives no usable answer."""
    program = folder / wanted.config_map / wanted.file
    if not program.is_file():
        raise NoEvidenceError(
            f"ConfigMap {wanted.config_map} has no key {wanted.file}: is the name right?"
        )
    with tempfile.TemporaryDirectory() as scratch:
        request = _request(wanted, evidence, Path(scratch))
        command = [sys.executable, "-I", "-m", "bagpipe.evaluate.own_process", str(program)]
        answer = _answered(command, json.dumps(request), wanted)
    return _judged(_finding(name, answer), answer, wanted)


def _request(wanted: OwnEvaluator, evidence: Evidence, scratch: Path) -> dict[str, Any]:
    ending, data = evidence.recorded.file()
    recording = scratch / f"recorded{ending}"
    recording.write_bytes(data)
    return {
        "function": wanted.function,
        "recording": str(recording),
        "start": evidence.start,
        "end": evidence.end,
        "lead_in_start": evidence.lead_in_start,
        "values": evidence.values,
        "result": evidence.result,
        "topics": wanted.topics,
    }


def _answered(command: list[str], request: str, wanted: OwnEvaluator) -> dict[str, Any]:
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        with subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=errors,
            env={"PATH": os.environ.get("PATH", os.defpath)},
            start_new_session=True,
        ) as process:
            try:
                process.communicate(request.encode(), timeout=duration_seconds(wanted.timeout))
            except subprocess.TimeoutExpired as late:
                raise NoEvidenceError(
                    f"{wanted.file} did not answer within {wanted.timeout}: raise `timeout`"
                ) from late
            finally:
                _end(process)
        output.seek(0)
        text = output.read(_LONGEST_ANSWER + 1)
        if process.returncode != 0:
            errors.seek(max(0, errors.seek(0, os.SEEK_END) - 2000))
            last = errors.read().decode(errors="replace").strip().splitlines()
            raise NoEvidenceError(
                f"{wanted.file} ended with status {process.returncode}:"
                f" {last[-1] if last else 'its stderr is empty'}"
            )
    try:
        answer = json.loads(text)
    except ValueError as error:
        raise NoEvidenceError(f"{wanted.file} gave no answer that can be read") from error
    if not isinstance(answer, dict):
        raise NoEvidenceError(f"{wanted.file} answered {type(answer).__name__} and no map")
    return answer


def _end(process: "subprocess.Popen[bytes]") -> None:
    """Ends the process with all that it started."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        return
    process.wait()


def _finding(name: str, answer: dict[str, Any]) -> Finding:
    outcome = answer.get("outcome")
    if outcome not in ("passed", "failed", "invalid"):  # of any type: a list has no hash
        raise NoEvidenceError(
            f"the evaluator's outcome is {str(outcome)[:100]!r}: return passed, failed or invalid"
        )
    direction = answer.get("direction", "")
    if direction not in ("lower", "higher", ""):
        raise NoEvidenceError(
            f"the evaluator's direction is {str(direction)[:100]!r}: return lower or higher"
        )
    figure = _number(answer, "figure")
    found = Finding(
        name,
        "own",
        outcome,
        figure,
        _text(answer, "unit", 32),
        _text(answer, "limit", 200),
        direction,
        _text(answer, "message", 1000),
        course=_course(answer),
    )
    if figure is None or math.isfinite(figure) or outcome == "invalid":
        return found
    message = f"the evaluator's figure is no finite number but {figure}"
    return replace(found, outcome="failed", figure=None, message=message, instead="failed")


def _judged(finding: Finding, answer: dict[str, Any], wanted: OwnEvaluator) -> Finding:
    share = _number(answer, "coverage")
    covered = _text(answer, "covered", 200)
    if share is None:
        return covering(finding, None, covered, "none", 0.0)
    if not 0 <= share <= 1:
        raise NoEvidenceError(f"the evaluator's coverage is {share:g}: return a share from 0 to 1")
    return covering(
        finding, share, covered or "what the evaluator says", "none", wanted.min_coverage
    )


def _course(answer: dict[str, Any]) -> dict[str, Any] | None:
    """How the figure went over time, by what the user's function says: `points` of a time in ns
    and a number, and if it likes `label`, `unit`, `low` and `high`.
    """
    course = answer.get("course")
    if course is None:
        return None
    points = course.get("points") if isinstance(course, dict) else None
    if not isinstance(points, list) or not all(_is_point(each) for each in points):
        raise NoEvidenceError(
            "the evaluator's course has no points: return a map whose points are pairs of a time"
            " in ns and a number"
        )
    return {
        "label": _text(course, "label", 200),
        "unit": _text(course, "unit", 32),
        "low": _bound(course, "low"),
        "high": _bound(course, "high"),
        "points": sorted((int(time), float(value)) for time, value in points),
    }


def _is_point(point: Any) -> bool:
    return (
        isinstance(point, list)
        and len(point) == 2
        and all(isinstance(each, int | float) and not isinstance(each, bool) for each in point)
        and 0 <= point[0] < _LATEST
        # One that is no number is shown as such; an integer may have no float.
        and (isinstance(point[1], float) or abs(point[1]) <= sys.float_info.max)
    )


def _bound(course: dict[str, Any], key: str) -> float | None:
    bound = _number(course, key)
    if bound is not None and not math.isfinite(bound):
        raise NoEvidenceError(f"the evaluator's course has no finite number as {key}")
    return bound


def _text(answer: dict[str, Any], key: str, most: int) -> str:
    """A text that can be written as UTF-8: JSON may escape halves of characters, too."""
    text = str(answer.get(key, ""))[:most]
    return text.encode("utf-8", "replace").decode()


def _number(answer: dict[str, Any], key: str) -> float | None:
    value = answer.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise NoEvidenceError(f"the evaluator's {key} is no number")
    try:
        return float(value)
    except OverflowError:  # an integer of hundreds of digits
        return math.inf
