"""What the API server refuses, in sentences that say what to do next."""

import json
import re
import ssl
from dataclasses import dataclass
from typing import Any

from bagpipe.cli.cluster.hints import in_context
from bagpipe.cli.places import RefusedError

_RULES = "docs/tasks/ci-gate.md has a Role to ask for"
_VALUE = re.compile(r"^(?:Invalid value|Unsupported value|Too long|Too many|Duplicate value): ")
_UNKNOWN_FIELD = re.compile(r'(unknown|duplicate) field "([^"]+)"')
# The API server says so when it stops at the first kind of faults; it is no fault of its own.
_UNCHECKED = "some validation rules were not checked"


class ClusterError(RefusedError):
    """The cluster can't be asked, or says no; `passing` if the same may go well in a moment."""

    def __init__(self, message: str, *, status: int = 0, passing: bool = False) -> None:
        super().__init__(message)
        self.status = status
        self.passing = passing


@dataclass(frozen=True)
class Asked:
    """What was asked for: `verb` as RBAC has it, `resource` such as `simulationjobs`."""

    verb: str
    resource: str
    name: str
    namespace: str
    context: str

    @property
    def what(self) -> str:
        """The object as people say it."""
        kind = {"simulationjobs": "job", "pods": "pod", "pods/log": "log of pod"}
        return f"{kind.get(self.resource, self.resource)} {self.name}".strip()


def refused(status: int, reason: str, body: str, asked: Asked) -> ClusterError:
    """The error for an answer of the API server.

    `status` is HTTP's, 0 where no connection came about; `body` a Status object or plain text.
    """
    status_object = _status_object(body)
    message = str(status_object.get("message") or body.strip() or reason)
    if status == 0:
        return ClusterError(
            f"no secure connection to the cluster of context {asked.context}: {reason}. Is its"
            " certificate-authority in the kubeconfig the right one?",
        )
    if status == 401:
        text = (
            f"the cluster of context {asked.context} does not know you: the credentials in the"
            " kubeconfig are missing, wrong or have expired. Log in again and try"
            f" `{_listing(asked)}`"
        )
    elif status == 403:
        text = _forbidden(message, asked)
    elif status == 404:
        text = _missing(status_object, asked)
    elif status == 409 and asked.verb == "create":
        text = (
            f"{asked.what} is there already in namespace {asked.namespace}: give another name with"
            " --name, or let --generate-name make one for each run"
        )
    elif status in (400, 422):
        found = refusals(status_object, message)
        text = f"{asked.what} is refused:\n" + "\n".join(f"  {s}" for s in found)
    else:
        text = f"the API server answered {status} when it was asked to {asked.verb} {asked.what}:"
        text = f"{text} {message}. Try again"
    return ClusterError(text, status=status, passing=status in (410, 429) or status >= 500)


def unreachable(error: Exception, asked: Asked) -> ClusterError:
    """The error for a server that does not answer."""
    return ClusterError(
        f"the cluster of context {asked.context} does not answer ({_short(error)}): is it up, is"
        " the network there, and is it the right context? `kubectl config get-contexts` lists them",
        passing=not any(isinstance(c, ssl.SSLCertVerificationError) for c in _causes(error)),
    )


def refusals(status_object: dict[str, Any], message: str) -> list[str]:
    """Each fault of a manifest as a sentence of its own: the field, and what to write."""
    unknown = _UNKNOWN_FIELD.findall(message)
    if unknown:
        return [
            f"{field}: there is no such field: is it misspelt, or below the wrong field?"
            if kind == "unknown"
            else f"{field}: this field is there twice: leave one out"
            for kind, field in dict.fromkeys(unknown)
        ]
    causes = (status_object.get("details") or {}).get("causes") or []
    found = [
        f"{cause.get('field') or 'the job'}: {plain(str(cause.get('message', '')))}"
        for cause in causes
        if _UNCHECKED not in str(cause.get("message", ""))
    ]
    unchecked = len(found) < len(causes) and found
    more = ["further rules are checked when these faults are mended"] if unchecked else []
    return list(dict.fromkeys(found)) + more or [message]


def plain(message: str) -> str:
    """A cause's message without the value that it repeats, where a sentence follows the value.

    `Invalid value: "object": write ...` becomes `write ...`.
    """
    begun = _VALUE.match(message)
    if begun is None:
        return message
    rest = message[begun.end() :]
    try:
        _, end = json.JSONDecoder().raw_decode(rest)
    except ValueError:
        return message
    return rest[end:].removeprefix(": ") if rest[end:].startswith(": ") else message


def _forbidden(message: str, asked: Asked) -> str:
    if " cannot " not in message:
        return f"{asked.what} is refused: {message}"
    resource = asked.resource
    if resource == "simulationjobs":
        resource = f"{resource}.sim.bagpipe.io"
    return (
        f"you may not {asked.verb} {asked.resource} in namespace {asked.namespace}: {message}."
        f" `kubectl auth can-i {asked.verb} {resource} -n {asked.namespace}{in_context()}` says"
        f" whether you may; {_RULES}"
    )


def _missing(status_object: dict[str, Any], asked: Asked) -> str:
    kind = (status_object.get("details") or {}).get("kind")
    if kind == "namespaces":
        return no_namespace(asked)
    if asked.resource == "simulationjobs" and not kind:
        return (
            f"the cluster of context {asked.context} knows no SimulationJobs: Bagpipe is not"
            " installed there. Install its chart (`helm install`), or choose another cluster with"
            " --context"
        )
    return f"there is no {asked.what} in namespace {asked.namespace}"


def no_namespace(asked: Asked) -> str:
    """The sentence for a namespace that is not there."""
    return (
        f"there is no namespace {asked.namespace} in the cluster of context {asked.context}:"
        " choose another with -n, or have it created and named in the chart value jobNamespaces"
    )


def no_job(asked: Asked, near: list[str], others: int) -> str:
    """The sentence for a job that is not there; `near` are names that look like it."""
    missing = f"there is no job {asked.name} in namespace {asked.namespace}"
    if near:
        return f"{missing}: did you mean {' or '.join(near)}?"
    if others:
        return f"{missing}: `{_listing(asked)}` lists those there are"
    return f"{missing}, and no other: is it in another namespace (-n)?"


def _listing(asked: Asked) -> str:
    return f"kubectl{in_context()} -n {asked.namespace} get simulationjobs"


def _status_object(body: str) -> dict[str, Any]:
    try:
        status_object = json.loads(body)
    except ValueError:
        return {}
    return status_object if isinstance(status_object, dict) else {}


def _short(error: Exception) -> str:
    """The last cause's own words: those around it repeat addresses of objects in memory."""
    last = _causes(error)[-1]
    text = str(last).rsplit(": ", 1)[-1] or type(last).__name__
    return text[:200]


def _causes(error: BaseException) -> list[BaseException]:
    """The error and what it came from, the first cause last."""
    found = [error]
    while (cause := found[-1].__cause__ or found[-1].__context__) is not None:
        found.append(cause)
    return found
