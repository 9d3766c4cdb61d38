"""The loop goes by what is, not by what has happened: repeated, lost and merged events are all one.

Over the fakes; tests/integration/control_plane shows the same with a real API server.
"""

import itertools
from collections.abc import Callable

import pytest
import yaml

from bagpipe_operator.api.objects import Json
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import PodBuilder, account, make_driver, make_executor, make_job
from tests.unit.operator.world import World

DONE = account("Complete", verdict="Passed", cases={"planned": 4, "passed": 4})

# What happens to a job's pods from its creation to its end, in order.
LIFE: list[Callable[[], list[PodBuilder]]] = [
    lambda: [make_driver("x")],
    lambda: [make_driver("x").running()],
    lambda: [make_executor("x").running(), make_driver("x").running()],
    lambda: [make_executor("x").ended(0), make_driver("x").ended(0, DONE)],
]


async def lived(seen: tuple[int, ...]) -> tuple[Json, list[int]]:
    """The status in the end when only those steps were seen, and the writes of each reconcile."""
    world, writes = World(), []
    await world.reconcile()
    world.drivers.says = account()
    for step in seen:
        world.deliver(*LIFE[step]())
        world.api.calls.clear()
        await world.reconcile()
        writes.append(world.api.calls.count("patch status"))
        await world.reconcile()
        writes.append(world.api.calls.count("patch status"))
    return world.status(), writes


EVERY_WAY = [
    (*some, 3) for count in range(4) for some in itertools.combinations(range(3), count)
] + [(0, 0, 1, 1, 2, 2, 3, 3)]


@pytest.mark.parametrize("seen", EVERY_WAY)
async def test_whatever_was_missed_the_end_is_the_same(seen: tuple[int, ...]) -> None:
    whole, _ = await lived((0, 1, 2, 3))
    status, _ = await lived(seen)
    assert status == whole
    assert (status["phase"], status["attempt"]) == ("Complete", 1)


async def test_a_reconcile_writes_one_status_and_the_same_again_none() -> None:
    _, writes = await lived((0, 1, 2, 3))
    # In pairs: after a step, and after one more reconcile. An executor that runs is no news here:
    # the driver has reported before that cases run.
    assert writes == [0, 0, 1, 1, 0, 0, 1, 1]


async def test_evaluators_are_the_administrators_to_allow() -> None:
    own = [{"name": "mine", "own": {"configMap": "lane"}}]
    world = World(make_job("x").with_spec("evaluate", own))
    await world.reconcile()
    assert world.reason("Failed") == "True/SpecInvalid"
    assert "ask an administrator for operator.ownEvaluators" in world.message("Failed")
    assert world.api.named("pods") == []


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("source", {"bags": ["https://evil.example/drive.bag"]}),
        ("source", {"sequence": [{"bag": "hdfs://evil.example/drive.bag"}]}),
        ("output", {"uri": "hdfs://evil.example/results"}),
        ("baseline", {"results": "https://evil.example/results"}),
    ],
)
async def test_servers_of_storage_are_the_administrators_to_allow(field: str, value: Json) -> None:
    settings = Settings(storage_hosts=("s3.lab", "*.lab"))
    world = World(make_job("x").with_spec(field, value), settings=settings)
    await world.reconcile()
    assert world.reason("Failed") == "True/SpecInvalid"
    assert "evil.example/" in world.message("Failed")
    assert "to add it to storage.allowedHosts" in world.message("Failed")
    assert world.api.named("pods") == []


async def test_pods_know_the_servers_of_storage_and_the_stack_does_not() -> None:
    world = World(make_job("x"), settings=Settings(storage_hosts=("s3.lab", "*.lab")))
    await world.reconcile()
    [driver] = [pod for (kind, _), pod in world.api.objects.items() if kind == "pods"]
    [config] = [each for (kind, _), each in world.api.objects.items() if kind == "configmaps"]
    hosts = {"name": "BAGPIPE_STORAGE_HOSTS", "value": "s3.lab,*.lab"}
    template = yaml.safe_load(config["data"]["executor.yaml"])
    (spark,), stack = template["spec"]["containers"], template["spec"]["initContainers"][-1]
    assert hosts in driver["spec"]["containers"][0]["env"]
    assert spark["env"] == [hosts]
    assert hosts not in stack["env"]


async def test_the_first_reconcile_makes_both_children_and_writes_once() -> None:
    world = World()
    await world.reconcile()
    made = ["try pods", "create configmaps", "create pods", "patch status", "create events"]
    assert world.api.calls == made
    await world.reconcile()
    assert world.api.calls == made
