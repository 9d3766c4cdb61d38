"""What answers of an API server say of a cluster and of a namespace's fitness for jobs. Pure."""

import re
from collections.abc import Iterable

from bagpipe.cli.health.finding import Finding
from bagpipe.cli.health.needs import Needs
from bagpipe.cli.health.replies import Answer, Json
from bagpipe.quantities import quantity

_LEAST = (1, 29)
_VERSION = re.compile(r"v?([0-9]+)\.([0-9]+)")
_KINDS = ("SimulationJob", "SimulationSchedule")
_ACCOUNTS = ("bagpipe-driver", "bagpipe-executor")
_LEVEL = "pod-security.kubernetes.io/enforce"
_ROLE = "sim.bagpipe.io/role"
_RULES = "docs/tasks/ci-gate.md has a Role to ask for"


def unanswered(part: str, what: str, answer: Answer, of: str) -> Finding:
    """The finding for a question that was refused or not answered: nothing is known."""
    if answer.status == 403:
        found, remedy = (
            f"you may not read {of}",
            f"ask your administrator, or for the right; {_RULES}",
        )
    elif answer.status == 401:
        found, remedy = "the cluster does not know you", "log in again: the credentials are expired"
    elif answer.status == 0:
        found, remedy = f"no answer: {answer.why}", "try again, with a longer --timeout"
    else:
        found, remedy = f"the API server answered {answer.status}: {answer.why}", "try again"
    return Finding(part, what, "unknown", found, remedy)


def of_version(answer: Answer, context: str) -> Finding:
    """Whether the API server answers, and is new enough."""
    what = "Kubernetes"
    if answer.status == 0:
        return Finding(
            "cluster", what, "unknown", f"the cluster of context {context} does not answer:"
            f" {answer.why}", "is it up, is the network there, and is it the right context?"
            " `kubectl config get-contexts` lists them",
        )  # fmt: skip
    if not answer.there:
        return unanswered("cluster", what, answer, "its version")
    if is_something_else(answer):
        return Finding(
            "cluster", what, "unknown", f"what answers for context {context} is no API server",
            "is a proxy or a login page between? `kubectl version` says what it sees",
        )  # fmt: skip
    version = str(answer.body["gitVersion"])
    found = _VERSION.match(version)
    if found is None:
        return Finding("cluster", what, "unknown", f"its version is {version[:40]!r}")
    if (int(found[1]), int(found[2])) < _LEAST:
        return Finding(
            "cluster", what, "missing", f"{version} knows no native sidecars",
            "a cluster of Kubernetes 1.29 or later is needed",
        )  # fmt: skip
    return Finding("cluster", what, "done", f"{version} at context {context}")


def is_something_else(answer: Answer) -> bool:
    """Whether that was no API server, of which nothing else is worth a question."""
    version = answer.body.get("gitVersion")
    return answer.there and not (isinstance(version, str) and version)


def of_kinds(answer: Answer) -> Finding:
    """Whether jobs and schedules are served."""
    if answer.status == 404:
        return Finding(
            "cluster", "CRDs", "missing", "the cluster knows no SimulationJobs",
            "install the chart (`helm install`, docs/start.md), or choose another --context",
        )  # fmt: skip
    if not answer.there:
        return unanswered("cluster", "CRDs", answer, "which kinds are served")
    served = {str(each.get("kind")) for each in _dicts(answer.body.get("resources"))}
    missing = [kind for kind in _KINDS if kind not in served]
    if missing:
        return Finding(
            "cluster", "CRDs", "missing", f"{' and '.join(missing)} is not served",
            "upgrade the chart: its CRDs are of an earlier release",
        )  # fmt: skip
    return Finding("cluster", "CRDs", "done", "jobs and schedules are served")


def of_schema(answer: Answer, own: Iterable[str]) -> Finding:
    """Whether the CRD has the fields of `spec` that this program knows, and no others."""
    what = "CRDs' version"
    if not answer.there:
        return unanswered("cluster", what, answer, "the schema of jobs")
    there = _spec_fields(answer.body)
    if there is None:
        return Finding("cluster", what, "unknown", "the API server shows no schema of jobs")
    known = set(own)
    if older := sorted(known - there):
        return Finding(
            "cluster", what, "missing", f"its jobs lack {_spec(older)}: the CRD is older than this"
            " program", "upgrade the chart, or use the program of that release",
        )  # fmt: skip
    if newer := sorted(there - known):
        return Finding(
            "cluster", what, "missing", f"its jobs have {_spec(newer)}: the CRD is newer than this"
            " program", "use the program of that release",
        )  # fmt: skip
    return Finding("cluster", what, "done", f"all {len(known)} fields of spec are this program's")


def of_right(answer: Answer, verb: str, namespace: str) -> Finding:
    """Whether the user may create jobs, by a SelfSubjectAccessReview."""
    what = f"your right to {verb} jobs"
    if not answer.there:
        return unanswered("namespace", what, answer, "your own rights")
    status = answer.body.get("status") or {}
    if status.get("allowed") is True:
        return Finding("namespace", what, "done", f"in namespace {namespace}")
    return Finding(
        "namespace", what, "missing", f"you may not {verb} simulationjobs in {namespace}", _RULES
    )


def of_operator(deployments: Answer, jobs: Answer, home: str) -> Finding:
    """Whether an operator works: by its Deployment, as far as the user may see it."""
    what = "operator"
    if not deployments.there or not deployments.items:
        if seen := _seen_at_work(jobs):
            return Finding(
                "cluster", what, "unknown", f"one wrote the status of job {seen} of this namespace;"
                " you can't see whether it still runs",
                "name its namespace by --operator-namespace",
            )  # fmt: skip
        if not deployments.there:
            return unanswered("cluster", what, deployments, f"deployments in namespace {home}")
        return Finding(
            "cluster", what, "unknown", f"there is none in namespace {home}",
            "name its namespace by --operator-namespace, or install the chart",
        )  # fmt: skip
    for each in deployments.items:
        wanted = (each.get("spec") or {}).get("replicas", 1)
        if not (each.get("status") or {}).get("readyReplicas", 0):
            return Finding(
                "cluster", what, "missing", f"none of {wanted} pods of {home}/{_name(each)} is"
                " ready", f"kubectl -n {home} describe deployment {_name(each)}",
            )  # fmt: skip
    version = _labels(deployments.items[0]).get("app.kubernetes.io/version", "")
    found = f"{home}/{_name(deployments.items[0])} {version}".rstrip()
    return Finding("cluster", what, "done", f"{found} is ready")


def of_namespace(answer: Answer, namespace: str, needs: Needs | None) -> list[Finding]:
    """Whether it is there, and what Pod Security in it refuses."""
    if answer.status == 404:
        return [
            Finding(
                "namespace", namespace, "missing", "there is no such namespace",
                "choose another with -n, or have it created and named in the chart value"
                " jobNamespaces",
            )
        ]  # fmt: skip
    if not answer.there:
        return [unanswered("namespace", "Pod Security", answer, f"namespace {namespace}")]
    if (answer.body.get("metadata") or {}).get("deletionTimestamp"):
        return [Finding("namespace", namespace, "missing", "it is being deleted", "use another")]
    level = _labels(answer.body).get(_LEVEL, "")
    found = [Finding("namespace", namespace, "done", "it is there")]
    if level == "restricted" and needs is not None and needs.loosens:
        found.append(
            Finding(
                "namespace", "Pod Security", "missing",
                f"restricted refuses stack.securityContext with {', '.join(needs.loosens)}",
                "leave that out, or have the namespace enforce baseline"
                " (docs/tasks/pod-templates.md)",
            )
        )  # fmt: skip
    else:
        takes = "a job that loosens nothing is taken" if level == "restricted" else "jobs are taken"
        found.append(
            Finding("namespace", "Pod Security", "done", f"{level or 'no level'}: {takes}")
        )
    return found


def of_accounts(answers: dict[str, Answer], namespace: str) -> list[Finding]:
    """The service accounts of a job's pods, by their names."""
    found = []
    for name in _ACCOUNTS:
        answer, what = answers[name], f"service account {name}"
        if answer.status == 404:
            found.append(
                Finding(
                    "namespace", what, "missing", f"it is not in {namespace}",
                    f"add {namespace} to the chart's jobNamespaces, or install the chart"
                    " bagpipe-namespace there (docs/operations/namespaces.md)",
                )
            )  # fmt: skip
        elif answer.there:
            found.append(Finding("namespace", what, "done", "it is there"))
        else:
            found.append(unanswered("namespace", what, answer, "service accounts"))
    return found


def pull_secrets_of(answers: dict[str, Answer]) -> list[str]:
    """The Secrets by which the accounts' pods pull images."""
    named = {
        str(each.get("name"))
        for name in _ACCOUNTS
        for each in _dicts(answers[name].body.get("imagePullSecrets"))
        if each.get("name")
    }
    return sorted(named)


def of_quota(answer: Answer, needs: Needs | None) -> list[Finding]:
    """Whether the namespace's quotas leave room for the job."""
    what = "quota"
    if not answer.there:
        return [unanswered("namespace", what, answer, "resource quotas")]
    if not answer.items:
        return [Finding("namespace", what, "done", "there is none")]
    if needs is None:
        names = ", ".join(sorted(_name(each) for each in answer.items)[:5])
        return [Finding("namespace", what, "done", f"{names}: name a job to compare it")]
    found = [_of_one_quota(each, needs) for each in answer.items]
    return [each for each in found if each.state != "done"] or found[:1]


def _of_one_quota(quota: Json, needs: Needs) -> Finding:
    status = quota.get("status") or {}
    hard = status.get("hard") or (quota.get("spec") or {}).get("hard") or {}
    used = status.get("used") or {}
    name = f"quota {_name(quota)}"
    for what, needed in needs.amounts.items():
        most, taken = _number(hard.get(what)), _number(used.get(what, "0"))
        if most is not None and needed > most:
            return Finding(
                "namespace", name, "missing",
                f"the job needs {_amount(what, needed)} of {what}, of which it gives {hard[what]}",
                "ask for less in spec.spark and stack.resources, or for a larger quota",
            )  # fmt: skip
        if most is not None and taken is not None and needed > most - taken:
            return Finding(
                "namespace", name, "unknown",
                f"the job needs {_amount(what, needed)} of {what}; {used.get(what)} of {hard[what]}"
                " are taken", "it waits until others have ended",
            )  # fmt: skip
    limits = [key for key in hard if key.startswith("limits.") and key not in needs.amounts]
    if limits:
        return Finding(
            "namespace", name, "missing",
            f"it has {', '.join(sorted(map(str, limits)))}, and Kubernetes refuses a pod that"
            " states no such limit",
            "write them into stack.resources.limits, or have a LimitRange set them",
        )  # fmt: skip
    return Finding("namespace", name, "done", "there is room for the job")


def of_policies(answer: Answer) -> Finding:
    """Whether network policies let a job's pods reach each other."""
    what = "network policies"
    if not answer.there:
        return unanswered("namespace", what, answer, "network policies")
    ours, closed, leaving = set(), [], []
    for policy in answer.items:
        spec = policy.get("spec") or {}
        labels = (spec.get("podSelector") or {}).get("matchLabels") or {}
        types = spec.get("policyTypes") or []
        if labels.get(_ROLE):
            ours.add(str(labels[_ROLE]))
        elif not labels and not (spec.get("podSelector") or {}).get("matchExpressions"):
            closed += [_name(policy)] if "Ingress" in types and not spec.get("ingress") else []
            leaving += [_name(policy)] if "Egress" in types else []
    if closed and not ours >= {"driver", "executor"}:
        return Finding(
            "namespace", what, "missing",
            f"{closed[0]} closes drivers and executors to each other",
            "have the chart value networkPolicy.enabled set: it lets a job's own pods in",
        )  # fmt: skip
    if leaving:
        return Finding(
            "namespace", what, "unknown", f"{leaving[0]} decides what pods may reach",
            "a job's pods need DNS, the API server (the driver) and the storage",
        )  # fmt: skip
    if ours:
        return Finding("namespace", what, "done", "a job's pods are open to each other alone")
    return Finding("namespace", what, "done", "none closes a job's pods")


def of_object(part: str, kind: str, name: str, answer: Answer) -> Finding:
    """A Secret, a ConfigMap or a priority class that is named."""
    what = f"{kind} {name}"
    if answer.there:
        return Finding(part, what, "done", "it is there")
    if answer.status == 404:
        return Finding(
            part, what, "missing", "it is not there", f"create it, or name another {kind}"
        )
    return unanswered(part, what, answer, f"this {kind}")


def of_claim(name: str, answer: Answer) -> Finding:
    """A volume claim that the job names."""
    what = f"claim {name}"
    if answer.there:
        phase = (answer.body.get("status") or {}).get("phase")
        modes = ", ".join(map(str, (answer.body.get("spec") or {}).get("accessModes") or []))
        if phase == "Bound":
            return Finding("job", what, "done", f"bound, {modes}")
        if phase == "Lost":
            return Finding("job", what, "missing", "its volume is lost", "make the claim again")
        return Finding(
            "job", what, "unknown", f"it is {phase or 'new'}: it has no volume yet",
            f"where its storage class binds at the first pod this is right; `kubectl describe pvc"
            f" {name}`",
        )  # fmt: skip
    if answer.status == 404:
        return Finding(
            "job", what, "missing", "it is not there",
            "create it, or name another in the job's pvc:// URIs",
        )  # fmt: skip
    return unanswered("job", what, answer, "volume claims")


def of_dry_run(answer: Answer, faults: list[str]) -> Finding:
    """What the API server says of the job, which it judges and does not keep."""
    what = "the job"
    if answer.there:
        return Finding("job", what, "done", "the API server takes it")
    if answer.status in (400, 422):
        return Finding("job", what, "missing", "; ".join(faults), "write what each says")
    if answer.status == 409:
        return Finding(
            "job", what, "missing", "there is a job of that name",
            "give another by submit --name or --generate-name",
        )  # fmt: skip
    return unanswered("job", what, answer, "what the API server says of it")


def _seen_at_work(jobs: Answer) -> str:
    for job in jobs.items:
        if (job.get("status") or {}).get("conditions"):
            return _name(job)
    return ""


def _spec_fields(document: Json) -> set[str] | None:
    """The fields below spec of a SimulationJob in an OpenAPI document."""
    schemas = (document.get("components") or {}).get("schemas") or {}
    for name, schema in schemas.items() if isinstance(schemas, dict) else []:
        if str(name).endswith(".SimulationJob") and isinstance(schema, dict):
            spec = (schema.get("properties") or {}).get("spec") or {}
            fields = spec.get("properties")
            return set(map(str, fields)) if isinstance(fields, dict) else None
    return None


def _spec(fields: list[str]) -> str:
    return ", ".join(f"spec.{each}" for each in fields[:5])


def _dicts(value: object) -> list[Json]:
    return [each for each in value if isinstance(each, dict)] if isinstance(value, list) else []


def _labels(obj: Json) -> dict[str, str]:
    labels = (obj.get("metadata") or {}).get("labels")
    return labels if isinstance(labels, dict) else {}


def _name(obj: Json) -> str:
    return str((obj.get("metadata") or {}).get("name") or "")


def _number(text: object) -> float | None:
    try:
        return quantity(str(text))
    except ValueError:
        return None


def _amount(what: str, needed: float) -> str:
    return f"{needed / 2**30:.3g}Gi" if what.endswith("memory") else f"{needed:g}"
