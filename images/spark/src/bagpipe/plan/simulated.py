"""The drive of a job whose source is a simulator, and its scenario under each condition."""

from pydantic import ValidationError

from bagpipe.matrix.faults import MatrixError
from bagpipe.matrix.templates import filled
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Conditions, crossing
from bagpipe.plan.fragments import Window
from bagpipe.simulator.model import START, Simulator
from bagpipe.simulator.scenario import Scenario
from bagpipe.spec import SimulationJobSpec

# The name of the one fragment, and what stands in a row in place of a bag's URI.
DRIVE = "drive"
SOURCE = "simulator"


def simulated_case(simulator: Simulator) -> Case:
    """The drive as a fragment without a bag: nothing of its own is read from storage."""
    window = Window(START, START, START + simulator.steps * simulator.step_nanoseconds)
    return Case(
        id=DRIVE,
        bag=SOURCE,
        bag_version="",
        window=window,
        connections=[],
        ranges=[],
        messages=simulator.steps,
    )


def scenario_of(simulator: Simulator, conditions: Conditions) -> Scenario:
    """The scenario with the case's values in it. Raises MatrixError where it makes no sense."""
    written = filled(dict(simulator.described), conditions.known, "source.simulator")
    try:
        return Scenario.model_validate(written)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(["source.simulator", *map(str, first["loc"])])
        values = ", ".join(f"{name} = {value}" for name, value in conditions.known.items())
        raise MatrixError(f"{place}: {first['msg']} (with {values})") from error


def check_scenarios(spec: SimulationJobSpec) -> None:
    """Reads every case's scenario once. Raises MatrixError, before anything runs."""
    if spec.source.simulator is None:
        return
    for _, conditions in crossing(spec).named:
        scenario_of(spec.source.simulator, conditions)
