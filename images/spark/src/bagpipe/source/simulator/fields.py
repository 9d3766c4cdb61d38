"""`source.simulator`: a simulated drive, and what it asks of the rest of a spec."""

from collections.abc import Iterator

from bagpipe.engine_fields import fields_of
from bagpipe.pieces import bags_of
from bagpipe.simulator.model import Simulator
from bagpipe.source_fields import SourceFields
from bagpipe.spec import SimulationJobSpec


def _refusal(spec: SimulationJobSpec) -> str | None:
    simulator: Simulator = spec.source.own
    return next(_refusals(spec, simulator), None)


def _refusals(spec: SimulationJobSpec, simulator: Simulator) -> Iterator[str]:
    if spec.source.kind not in fields_of(spec.stack.engine).sources:
        yield "source.simulator speaks ROS 1: leave out stack.engine"
    if spec.playback.mode != "lockstep":
        yield (
            "source.simulator waits for the stack: write playback.mode: lockstep, and"
            " playback.steps with the topics that it answers"
        )
    if simulator.topics.control not in {step.answer for step in spec.playback.steps}:
        yield (
            f"no step of playback.steps has the answer {simulator.topics.control}, by which"
            " the simulated car is steered: write for example {trigger:"
            f" {simulator.topics.odometry}, answer: {simulator.topics.control}}}"
        )
    published = simulator.topics.spoken + simulator.recorded_topics
    for step in spec.playback.steps:
        if step.trigger not in published:
            yield (
                f"the step's trigger {step.trigger} is no topic of the simulator: it has"
                f" {', '.join(published)}"
            )
    if spec.stack.remap or any(variant.remap for variant in spec.variants):
        yield (
            "remap joins a stack's names to a recording's: with source.simulator write the"
            " stack's names into source.simulator.topics"
        )
    if any(c.error and c.error.recording for c in spec.evaluate):
        yield (
            "evaluate[].error.recording compares with a bag's own output, and"
            " source.simulator has no bag: name a truth, such as"
            f" {simulator.topics.odometry}"
        )


FIELDS = SourceFields(
    type=Simulator | None,
    default=None,
    uris=lambda simulator: bags_of(simulator.recorded),
    topics=lambda simulator: simulator.topics.spoken,
    meaningless={
        ("topics",): (
            "source.topics select from bags: leave them out with source.simulator, whose own"
            " names are in source.simulator.topics"
        )
    },
    refusal=_refusal,
    place=3,
)
