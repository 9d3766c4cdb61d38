"""A simulated drive in place of a recording: the worker's half of its turns with the stack."""

from typing import Any

from bagpipe.engine_fields import fields_of
from bagpipe.plan.case import Case
from bagpipe.simulator.messages import ControlError
from bagpipe.simulator.model import Simulator
from bagpipe.simulator.serialisation import serialisation
from bagpipe.simulator.world import NeverAnsweredError, Steering, World
from bagpipe.source.simulator.beside import RecordedTopics
from bagpipe.source.simulator.planning import scenario_of
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from bagpipe.topic_patterns import records
from bagpipe.wire.hello_case import HelloSimulator
from bagpipe.wire.session import SessionError


class Drive:
    """One case's world, as a partner of the session. Raises SessionError and StorageError."""

    def __init__(
        self, case: Case, spec: SimulationJobSpec, simulator: Simulator, storage: Storage
    ) -> None:
        steps = [s for s in spec.playback.steps if s.answer == simulator.topics.control]
        required = frozenset(step.trigger for step in steps if not step.optional)
        steering = Steering(required, bool(required))
        written = serialisation(fields_of(spec.stack.engine).encoding)
        beside = RecordedTopics(case, storage, written.name) if case.parts else None
        scenario = scenario_of(simulator, case.conditions)
        self._world = World(simulator, scenario, steering, written, beside)
        named = spec.record.topics if spec.record else []
        own = set(simulator.topics.spoken)
        self._recorded = {
            each.topic: each.topic in own or any(records(name, each.topic) for name in named)
            for each in self._world.publications
        }

    @property
    def described(self) -> HelloSimulator:
        """The case's `simulator` in HELLO."""
        return {
            "publications": [
                {
                    "topic": each.topic,
                    "type": each.type,
                    "md5sum": each.md5sum,
                    "definition": each.definition,
                    "latching": each.latching,
                    "recorded": self._recorded[each.topic],
                }
                for each in self._world.publications
            ]
        }

    def step(self, answer: dict[str, Any], /) -> dict[str, Any] | None:
        """The next moment. Raises SessionError where the stack does not steer."""
        try:
            return self._world.step(answer)
        except ControlError as error:
            raise SessionError("BadControl", str(error)) from error
        except NeverAnsweredError as error:
            raise SessionError("StackNeverAnswered", str(error)) from error
