"""`source.ticks`: how many ticks, how far apart."""

from pydantic import Field

from bagpipe.pod_spec import SpecModel
from bagpipe.source_fields import SourceFields
from bagpipe.spec import SimulationJobSpec
from bagpipe.texts import Name, PositiveDuration


class Ticks(SpecModel):
    """std_msgs/UInt32 on one topic: 0, 1, 2 and so on."""

    count: int = Field(ge=1, le=1000)
    every: PositiveDuration = "100ms"
    topic: Name = "/ticks"


def _refusal(spec: SimulationJobSpec) -> str | None:
    if spec.playback.rounds > spec.source.own.count:
        return (
            "source.ticks are played in at most as many rounds as there are: lower playback.rounds"
        )
    return None


FIELDS = SourceFields(
    type=Ticks | None,
    default=None,
    bags=False,
    taken_as="bags",
    reasons=frozenset({"TicksMissing"}),
    meaningless={
        ("topics", "fragment"): (
            "source.topics and source.fragment select from bags: leave them out with source.ticks"
        )
    },
    refusal=_refusal,
    schema={
        "type": "object",
        "description": "Ticks of a counter, as std_msgs/UInt32, in place of a recording.",
        "required": ["count"],
        "properties": {
            "count": {
                "type": "integer", "description": "How many.", "minimum": 1, "maximum": 1000,
            },
            "every": {
                "type": "string", "description": "How far apart.", "default": "100ms",
                "maxLength": 64,
            },
            "topic": {
                "type": "string", "description": "On which topic.", "default": "/ticks",
                "maxLength": 256,
            },
        },
    },
)  # fmt: skip
