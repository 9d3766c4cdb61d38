"""Whether any node of the cluster could take one of a job's pods. Pure.

It is compared with what a node has for pods at all, not with what others leave of it: a job waits
for room, but never gets more than there is.
"""

from collections import Counter
from collections.abc import Iterable, Mapping

from bagpipe.cli.health.cluster import unanswered
from bagpipe.cli.health.finding import Finding
from bagpipe.cli.health.needs import PodNeed
from bagpipe.cli.health.replies import Answer, Json
from bagpipe.quantities import quantity, size

_ARCHITECTURE = "kubernetes.io/arch"
# Whoever adds nodes by need marks those that it has made.
_AUTOSCALERS = ("karpenter.sh/", "cluster-autoscaler.kubernetes.io/")
_MOST_REASONS = 4
# These come and go by themselves, and a pod that is new to a node waits for them.
_PASSING = "node.kubernetes.io/"
_WHAT = "a node for"


def of_nodes(answer: Answer, pods: Iterable[PodNeed]) -> list[Finding]:
    """A finding for each kind of pod, and one where the images have to be of several kinds."""
    if not answer.there:
        return [unanswered("job", "nodes", answer, "nodes")]
    nodes = answer.items
    if not nodes:
        return [Finding("job", "nodes", "unknown", "the cluster has none now")]
    whole = not (answer.body.get("metadata") or {}).get("continue")
    found, kinds = [], set()
    for pod in pods:
        reasons = [_refusal(node, pod) for node in nodes]
        fit = [node for node, reason in zip(nodes, reasons, strict=True) if not reason]
        kinds |= {_labels(node).get(_ARCHITECTURE, "") for node in fit}
        refusals = [reason for reason in reasons if reason]
        found.append(_of_pod(pod, nodes, len(fit), refusals, whole))
    if len(named := sorted(kinds - {""})) > 1:
        found.append(
            Finding(
                "job", "architecture", "unknown",
                f"the job's pods may come to nodes of {' and '.join(named)}",
                "the operator sends them to amd64, unless its administrator says otherwise"
                " (images.architecture); to be sure, name one in spark.executor.pod and"
                f" spark.driver.pod: nodeSelector: {{{_ARCHITECTURE}: {named[0]}}}",
            )
        )  # fmt: skip
    return found


def _of_pod(pod: PodNeed, nodes: list[Json], fit: int, reasons: list[str], whole: bool) -> Finding:
    what, asked = f"{_WHAT} {pod.role}", _amounts(pod.amounts)
    if fit:
        unseen = "; its affinity was not looked at" if pod.has_affinity else ""
        return Finding(
            "job", what, "done", f"{fit} of {len(nodes)} could take one ({asked}){unseen}"
        )
    counted = Counter(reasons).most_common(_MOST_REASONS)
    why = ", ".join(f"{count} {reason}" for reason, count in counted)
    grows = any(_is_made_by_need(node) for node in nodes)
    of = f"{len(nodes)}" if whole else f"the first {len(nodes)}"
    return Finding(
        "job", what, "unknown" if grows or not whole else "missing",
        f"none of {of} takes one ({asked}): {why}",
        "nodes are added here by need: are there such that fit?" if grows
        else "ask for less in spec.spark and stack.resources, or write nodeSelector and"
        " tolerations (docs/tasks/pod-templates.md)",
    )  # fmt: skip


def _refusal(node: Json, pod: PodNeed) -> str:
    """Why a node takes no such pod, in words that are alike for nodes alike; empty if it does."""
    spec, status = node.get("spec") or {}, node.get("status") or {}
    if spec.get("unschedulable"):
        return "closed to pods (cordoned)"
    if not any(
        each.get("type") == "Ready" and each.get("status") == "True"
        for each in _dicts(status.get("conditions"))
    ):
        return "not ready"
    labels = _labels(node)
    for key, value in pod.selector.items():
        if labels.get(key) != value:
            return f"without the label {key}={value}"
    for taint in _dicts(spec.get("taints")):
        if not _is_tolerated(taint, pod):
            value = f"={taint['value']}" if taint.get("value") else ""
            return f"with the taint {taint.get('key')}{value}:{taint.get('effect')}"
    has = status.get("allocatable") or {}
    for what, needed in pod.amounts.items():
        there = _number(has.get(what, "0"))
        if there is not None and there < needed:
            return f"with {_amount(what, there)} of {what}"
    return ""


def _is_tolerated(taint: Json, pod: PodNeed) -> bool:
    effect, key = taint.get("effect"), str(taint.get("key") or "")
    if effect == "PreferNoSchedule" or key.startswith(_PASSING):
        return True
    for each in pod.tolerations:
        if each.effect not in (None, "", effect):
            continue
        if each.operator == "Exists" and each.key in (None, "", key):
            return True
        if each.operator != "Exists" and (each.key, each.value or "") == (
            key, str(taint.get("value") or ""),
        ):  # fmt: skip
            return True
    return False


def _is_made_by_need(node: Json) -> bool:
    meta = node.get("metadata") or {}
    keys = [*_labels(node), *(meta.get("annotations") or {})]
    return any(str(key).startswith(_AUTOSCALERS) for key in keys)


def _amounts(amounts: Mapping[str, float]) -> str:
    return ", ".join(f"{_amount(what, needed)} of {what}" for what, needed in amounts.items())


def _amount(what: str, number: float) -> str:
    return size(number) if what in ("memory", "ephemeral-storage") else f"{number:g}"


def _labels(node: Json) -> dict[str, str]:
    labels = (node.get("metadata") or {}).get("labels")
    return labels if isinstance(labels, dict) else {}


def _dicts(value: object) -> list[Json]:
    return [each for each in value if isinstance(each, dict)] if isinstance(value, list) else []


def _number(text: object) -> float | None:
    try:
        return quantity(str(text))
    except ValueError:
        return None
