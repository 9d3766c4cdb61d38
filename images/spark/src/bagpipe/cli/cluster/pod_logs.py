"""Parts of logs, each with where it comes from or why it is not there."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

from bagpipe.cli.cluster.case_lines import of_all, of_case
from bagpipe.cli.cluster.faults import ClusterError
from bagpipe.cli.cluster.state import JobState, Json
from bagpipe.report.details import lost_start

STACK, AGENT, DRIVER, EXECUTOR = "stack", "agent", "driver", "executor"

# Of each container; a case's lines are looked for among them.
_MOST_LINES = 20_000
_MOST_BYTES = 8 << 20
_MOST_EXECUTORS = 50


class Pods(Protocol):
    """Where pods and their logs are seen."""

    def pods(self, uid: str, role: str) -> list[Json]:
        """A job's pods in a role. Raises ClusterError."""

    def log(self, pod: str, container: str, lines: int, most_bytes: int) -> str:
        """The last lines of a container. Raises ClusterError."""


@dataclass(frozen=True)
class LogPart:
    """Lines of `of`, from `source`; or no line, and why."""

    of: str
    source: str
    lines: list[str] = field(default_factory=list)
    missing: str = ""

    def as_json(self) -> Json:
        """For --output json and yaml."""
        return {"of": self.of, "from": self.source, "lines": self.lines, "missing": self.missing}


def kept(row: Json, where: str) -> list[LogPart]:
    """What the results keep of one case: how it ended, the stack's last lines, starts lost."""
    ended = [f"{row['outcome']} {row.get('reason') or ''}".strip()]
    ended += [str(row["message"])] if row.get("message") else []
    parts = [LogPart("outcome", where, ended)]
    stack = (row.get("result") or {}).get("stack") or {}
    for stream in ("stdout", "stderr"):
        lines = stack.get(stream) or (row.get("stderr") if stream == "stderr" else None) or []
        if lines:
            parts.append(LogPart(f"stack {stream}", f"{where}, the last lines", list(lines)))
    lost = (row.get("evidence") or {}).get("starts") or []
    if lost:
        parts.append(LogPart("lost starts", where, [lost_start(start) for start in lost]))
    if len(parts) == 1:
        parts.append(LogPart(STACK, where, missing="the stack wrote nothing in this case"))
    return parts


def driver_log(cluster: Pods, state: JobState, tail: int, case: str | None) -> LogPart:
    """The driver's log, or its lines that name a case."""
    if not state.driver:
        return LogPart(DRIVER, "", missing=f"the job has no driver: {state.message}")
    source = f"pod {state.driver}, container driver"
    try:
        lines = cluster.log(state.driver, "driver", _lines(tail, case), _MOST_BYTES).splitlines()
    except ClusterError as error:
        return LogPart(DRIVER, source, missing=error.message)
    if case is not None:
        lines = [line for line in lines if _names(line, case)]
        if not lines:
            missing = (
                f"no line of the last {_MOST_LINES:,} names {case}: leave out the case to see the"
                " whole log"
            )
            return LogPart(DRIVER, source, missing=missing)
    return LogPart(DRIVER, source, lines[-tail:], "" if lines else "it has written nothing yet")


def executor_logs(
    cluster: Pods, state: JobState, of: str, tail: int, case: str | None, engine: str
) -> list[LogPart]:
    """The executors' containers: Spark's, or what stack or agent wrote, of one case or of all."""
    try:
        pods = cluster.pods(state.pods_of or state.uid, EXECUTOR)
    except ClusterError as error:
        return [LogPart(of, "", missing=error.message)]
    if not pods:
        return [LogPart(of, "", missing=_no_executors(state))]
    found = list(_log_parts(cluster, pods[:_MOST_EXECUTORS], of, tail, case, engine))
    with_lines = [part for part in found if part.lines]
    if with_lines or case is None:
        return with_lines or found
    faults = [part for part in found if part.missing]
    asked = f"{min(len(pods), _MOST_EXECUTORS)} of {len(pods)} executors"
    missing = (
        f"the last {_MOST_LINES:,} lines of {asked} have none of case {case}: it has not begun, or"
        " its executor is gone"
    )
    return faults or [LogPart(of, asked, missing=missing)]


def _log_parts(
    cluster: Pods, pods: list[Json], of: str, tail: int, case: str | None, engine: str
) -> Iterator[LogPart]:
    for pod in pods:
        name = pod["metadata"]["name"]
        stacks = _stack_containers(pod)
        if of == EXECUTOR:
            if case is not None and not _runs(cluster, name, stacks, case, engine):
                continue
            yield _one(cluster, name, "spark", of, tail, lambda log: log.splitlines())
            continue
        for container in stacks:
            yield _one(
                cluster, name, container, of, tail,
                lambda log: of_case(log, case, of, engine) if case else of_all(log, of, engine),
            )  # fmt: skip


def _one(cluster: Pods, pod: str, container: str, of: str, tail: int, chosen: Any) -> LogPart:
    source = f"pod {pod}, container {container}"
    try:
        log = cluster.log(pod, container, _MOST_LINES, _MOST_BYTES)
    except ClusterError as error:
        return LogPart(of, source, missing=error.message)
    return LogPart(of, source, chosen(log)[-tail:])


def _runs(cluster: Pods, pod: str, containers: list[str], case: str, engine: str) -> bool:
    """Whether the pod's stack containers have logged anything of a case."""
    for container in containers:
        try:
            log = cluster.log(pod, container, _MOST_LINES, _MOST_BYTES)
        except ClusterError:
            continue
        if of_case(log, case, STACK, engine) or of_case(log, case, AGENT, engine):
            return True
    return False


def _stack_containers(pod: Json) -> list[str]:
    """The containers with the user's images, which are native sidecars."""
    names = [c["name"] for c in pod["spec"].get("initContainers") or []]
    return [name for name in names if name == STACK or name.startswith(f"{STACK}-")]


def _no_executors(state: JobState) -> str:
    if state.ended:
        return (
            "the executors' pods went with the end of the job, and their logs with them: what is"
            " kept is in the results"
        )
    return f"the job has no executors yet: {state.message}"


def _names(line: str, case: str) -> bool:
    """Whether the case is named, and not one whose name only holds this one's."""
    return re.search(rf"(?<![\w.-]){re.escape(case)}(?![\w-]|\.\w)", line) is not None


def _lines(tail: int, case: str | None) -> int:
    return tail if case is None else _MOST_LINES
