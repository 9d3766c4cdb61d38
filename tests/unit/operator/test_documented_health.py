"""The health checks for Flux and Argo CD in the documentation state of a job what they should."""

import re
from pathlib import Path

import cel
import pytest
import yaml

from bagpipe_operator.api import conditions, names
from bagpipe_operator.api.objects import Json
from tests.unit.operator.builders import account, make_driver, make_executor, make_job
from tests.unit.operator.world import World

PAGE = Path(__file__).parents[3] / "docs/reference/conditions.md"


def documented(key: str) -> Json:
    """The YAML block of the page that has a key."""
    blocks = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (found,) = [block for block in map(yaml.safe_load, blocks) if key in block]
    loaded: Json = found[key]
    return loaded


async def new(world: World) -> None:
    await world.reconcile()


async def planning(world: World) -> None:
    await world.reconcile()
    world.deliver(make_driver("x").running())
    await world.reconcile(after=2)


async def running(world: World) -> None:
    await planning(world)
    world.deliver(make_executor("x").running())
    world.drivers.says = account()
    await world.reconcile(after=2)


async def complete(world: World) -> None:
    await running(world)
    world.deliver(make_driver("x").ended(0, account("Complete", verdict="Failed")))
    await world.reconcile(after=2)


async def passed(world: World) -> None:
    await running(world)
    world.deliver(make_driver("x").ended(0, account("Complete", verdict="Passed")))
    await world.reconcile(after=2)


async def failed(world: World) -> None:
    await running(world)
    world.deliver(make_driver("x").ended(1, account("Failed", reason="BagMissing")))
    await world.reconcile(after=2)


EXPECTED = {
    new: ("InProgress", "Progressing"),
    planning: ("InProgress", "Progressing"),
    running: ("InProgress", "Progressing"),
    complete: ("Failed", "Degraded"),
    passed: ("Current", "Healthy"),
    failed: ("Failed", "Degraded"),
}


@pytest.mark.parametrize("reached", EXPECTED, ids=lambda step: str(step.__name__))
async def test_flux_sees_what_a_job_is(reached: object) -> None:
    assert callable(reached)
    (check,) = documented("spec")["healthCheckExprs"]
    assert (check["apiVersion"], check["kind"]) == (names.API_VERSION, names.KIND)
    world = World(make_job("x"))
    await reached(world)
    # The order that Flux asks in; whatever is neither is in progress.
    states = [("failed", "Failed"), ("current", "Current")]
    job = {"status": world.status()}
    found = next((state for key, state in states if cel.evaluate(check[key], job)), "InProgress")
    assert found == EXPECTED[reached][0]


def test_argo_cd_sees_the_conditions_that_end_or_rest_a_job() -> None:
    script = documented("data")[f"resource.customizations.health.{names.GROUP}_{names.KIND}"]
    known = (conditions.PASSED, conditions.SUSPENDED, conditions.RUNNING)
    assert re.findall(r'condition\.type == "(\w+)"', script) == list(known)
    means = dict(re.findall(r'(\w+) = "(Healthy|Degraded|Suspended)"', script))
    assert means == {"True": "Healthy", "False": "Degraded", "status": "Suspended"}
    assert script.count("return") == 4
