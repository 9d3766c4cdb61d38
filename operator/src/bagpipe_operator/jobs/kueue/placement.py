"""Where an admitted job's pods go: what its Workload's flavors and checks say of them. Pure."""

from collections.abc import Iterable, Mapping

from bagpipe.pod_spec import PodSettings, Toleration
from bagpipe.spec import SimulationJobSpec
from bagpipe_operator.api import readings
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.kueue.workload import DRIVER, EXECUTORS
from bagpipe_operator.jobs.kueue.workload_view import WorkloadView


def flavors_of(workload: WorkloadView) -> list[str]:
    """The names of the flavors that the Workload's pod sets have."""
    return sorted({name for found in workload.flavors.values() for name in found})


def placed(
    spec: SimulationJobSpec, workload: WorkloadView, flavors: Mapping[str, Json]
) -> SimulationJobSpec:
    """The spec with its pods where the queue has reserved their quota.

    `flavors` are the specs of the ResourceFlavors by name. The pods do not name the queue any
    more: Kueue would hold each of them back once more. Raises ValueError for a toleration that
    is none.
    """
    driver = _pod(spec.spark.driver.pod, _updates(DRIVER, workload, flavors))
    executor = _pod(spec.spark.executor.pod, _updates(EXECUTORS, workload, flavors))
    spark = spec.spark.model_copy(
        update={
            "driver": spec.spark.driver.model_copy(update={"pod": driver}),
            "executor": spec.spark.executor.model_copy(update={"pod": executor}),
        }
    )
    return spec.model_copy(update={"spark": spark, "queue_name": None})


def _updates(pod_set: str, workload: WorkloadView, flavors: Mapping[str, Json]) -> list[Json]:
    """What is added to the pods of a set, as `podSetUpdates` write it."""
    named = [flavors[name] for name in workload.flavors.get(pod_set, ())]
    of_flavors = [
        {"nodeSelector": each.get("nodeLabels"), "tolerations": each.get("tolerations")}
        for each in named
    ]
    return [*of_flavors, *workload.updates.get(pod_set, ())]


def _pod(pod: PodSettings, updates: Iterable[Json]) -> PodSettings:
    labels, annotations = dict(pod.labels), dict(pod.annotations)
    selector, tolerations = dict(pod.node_selector), list(pod.tolerations)
    for update in updates:
        labels |= readings.mapping(update.get("labels"))
        annotations |= readings.mapping(update.get("annotations"))
        selector |= readings.mapping(update.get("nodeSelector"))
        tolerations += [each for each in _tolerations(update) if each not in tolerations]
    return pod.model_copy(
        update={
            "labels": labels,
            "annotations": annotations,
            "node_selector": selector,
            "tolerations": tolerations,
        }
    )


def _tolerations(update: Json) -> list[Toleration]:
    found = update.get("tolerations") or []
    if not isinstance(found, list):
        raise ValueError("tolerations is no list")  # noqa: TRY004 - a stranger's text, no bug of ours
    return [Toleration.model_validate(each) for each in found]
