"""The drive of a job whose source is a simulator, and its scenario under each condition."""

import dataclasses

from pydantic import ValidationError

from bagpipe.matrix.faults import MatrixError
from bagpipe.matrix.templates import filled
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Conditions, Crossing
from bagpipe.plan.fragments import Window
from bagpipe.plan.made import Plan
from bagpipe.plan.part import Part
from bagpipe.plan.parts import PartPlanner, version_of
from bagpipe.plan.put_together import put_together
from bagpipe.simulator.model import START, Simulator
from bagpipe.simulator.scenario import Scenario
from bagpipe.storage import Storage

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


def check_scenarios(simulator: Simulator, conditions: Crossing) -> None:
    """Reads every case's scenario once. Raises MatrixError, before anything runs."""
    for _, condition in conditions.named:
        scenario_of(simulator, condition)


def drives(simulator: Simulator, encoding: str, conditions: Crossing, storage: Storage) -> Plan:
    """The simulated drive with its recorded topics, under every condition. Raises MatrixError."""
    planner = PartPlanner(storage, encoding)
    length = simulator.steps * simulator.step_nanoseconds
    drive = simulated_case(simulator)

    def beside(parts: list[Part]) -> Case:
        return dataclasses.replace(drive, bag_version=version_of(parts), parts=parts)

    return put_together(
        conditions,
        simulator.recorded,
        DRIVE,
        "source.simulator.recorded",
        lambda pieces: planner.beside(pieces, START, length),
        beside,
    )
