"""The maps of a simulator's turns with the stack."""

from typing import Annotated

from pydantic import Field, Strict, TypeAdapter
from typing_extensions import TypedDict  # pydantic asks for it before Python 3.12

from bagpipe.wire.maps.shape import Natural, open_map

# MessagePack has lists alone.
Sent = Annotated[tuple[Natural, bytes | Natural], Strict(False)]
Answered = Annotated[tuple[str, str, bytes], Strict(False)]


@open_map
class Step(TypedDict):
    """The next moment of a simulated drive."""

    time: Annotated[
        Natural,
        Field(description="Simulated time in nanoseconds, later than that of the STEP before."),
    ]
    messages: Annotated[
        list[Sent],
        Field(
            description="Serialised ROS 1 messages, in their order: the topic's place in"
            " `publications`, and the bytes, or their number where they lie in DATA."
        ),
    ]


@open_map
class Answer(TypedDict):
    """What the stack published since the ANSWER before."""

    messages: Annotated[
        list[Answered],
        Field(
            description="The latest message of each topic that is the answer of a step and has one:"
            " topic, type as its publisher names it, serialised message."
        ),
    ]


ANSWER = TypeAdapter(Answer)
