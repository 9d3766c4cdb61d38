"""The case that HELLO carries to an agent: its shape, once for both ends of the pipe.

docs/reference/hello-case.json is written from it (docs/site/pipe_maps.py), and the agent's struct
is compared with it (tests/integration/test_hello_case.py). Whatever has a default may be left out.
"""

import functools
from typing import Annotated, Any, Literal, NotRequired

from pydantic import AfterValidator, ConfigDict, Field, JsonValue, TypeAdapter, with_config
from typing_extensions import TypedDict  # pydantic asks for it before Python 3.12

from bagpipe.engine_fields import DEFAULT_ENGINE, engine_names, fields_of

# A receiver ignores keys that it does not know: those of a later version.
_open = with_config(ConfigDict(extra="allow"))
_MONTH = 31 * 24 * 3600.0

Schema = dict[str, Any]


def _default(value: object, description: str) -> Any:
    return Field(description=description, json_schema_extra={"default": value})  # type: ignore[dict-item]


def _agent_engines() -> list[str]:
    return list(dict.fromkeys(fields_of(name).agent for name in engine_names()))


def _one_of_the_agent(engine: str) -> str:
    if engine not in _agent_engines():
        raise ValueError(f"engine is {engine!r}, not {' or '.join(_agent_engines())}")
    return engine


def _engines_in(schema: Schema) -> None:
    schema |= {"enum": _agent_engines(), "default": DEFAULT_ENGINE}


def _has_a_program(command: list[str]) -> list[str]:
    if not command[0]:
        raise ValueError("stack.command is empty")
    return command


_PROGRAM_FIRST: Any = {"prefixItems": [{"type": "string", "minLength": 1}]}
Natural = Annotated[int, Field(ge=0, lt=2**64)]
Seconds = Annotated[float, Field(ge=0, le=_MONTH)]


@_open
class HelloWindow(TypedDict):
    """Nanoseconds of bag time."""

    lead_in_start: Annotated[Natural, Field(description="What is played first, as warm-up.")]
    start: Annotated[Natural, Field(description="The first moment that counts.")]
    end: Annotated[Natural, Field(description="The first moment behind the window.")]


@_open
class HelloQos(TypedDict):
    """Quality of service; what is nil is offered as it was recorded."""

    reliability: NotRequired[
        Annotated[
            Literal["reliable", "bestEffort"] | None,
            _default(None, "Whether lost messages are sent again."),
        ]
    ]
    durability: NotRequired[
        Annotated[
            Literal["volatile", "transientLocal"] | None,
            _default(None, "Whether late subscribers get the last messages."),
        ]
    ]
    depth: NotRequired[
        Annotated[
            Annotated[int, Field(ge=1, lt=2**32)] | None,
            _default(None, "How many messages are kept for a subscriber."),
        ]
    ]


@_open
class HelloStack(TypedDict):
    """The software under test."""

    command: Annotated[
        list[str],
        Field(min_length=1, description="Its words.", json_schema_extra=_PROGRAM_FIRST),
        AfterValidator(_has_a_program),
    ]
    environment: NotRequired[
        Annotated[dict[str, str], _default({}, "Variables beside the container's own.")]
    ]
    parameters: NotRequired[
        Annotated[
            dict[str, JsonValue],
            _default({}, "For the parameter server; in ROS 2 `/node/name` is that node's `name`."),
        ]
    ]
    remap: NotRequired[
        Annotated[dict[str, str], _default({}, "Recorded topics and the names to publish them by.")]
    ]
    qos: NotRequired[
        Annotated[
            dict[str, HelloQos],
            _default({}, "In ROS 2: recorded topics and what is offered for them in its place."),
        ]
    ]
    player: NotRequired[
        Annotated[
            Literal["auto", "rcl", "dds"],
            _default(
                "auto", "In ROS 2: by the image's librcl, on DDS alone, or the first if it loads."
            ),
        ]
    ]
    active: NotRequired[
        Annotated[
            list[str], _default([], "In ROS 2: nodes with a life cycle that have to be active.")
        ]
    ]
    flow_control: NotRequired[
        Annotated[
            bool,
            _default(True, "In ROS 2: whether nodes wait for room in sockets when they publish."),
        ]
    ]
    master: NotRequired[
        Annotated[
            Literal["agent", "image"],
            _default("agent", "In ROS 1: the agent's own, or the rosmaster of the image."),
        ]
    ]


@_open
class HelloStep(TypedDict):
    """An input and the answer that the next one waits for."""

    trigger: Annotated[str, Field(description="The input's topic.")]
    answer: Annotated[str, Field(description="The answer's topic.")]
    deadline: Annotated[Seconds, Field(description="How long the answer is waited for.")]
    by: NotRequired[
        Annotated[Literal["count", "stamp"], _default("count", "How an answer is recognised.")]
    ]
    optional: NotRequired[
        Annotated[bool, _default(False, "Whether an input may stay without an answer.")]
    ]


@_open
class HelloPlayback(TypedDict):
    """How messages are released."""

    mode: NotRequired[
        Annotated[Literal["realtime", "max", "lockstep"], _default("realtime", "The pace.")]
    ]
    rate: NotRequired[Annotated[float, _default(1.0, "How fast, in realtime.")]]
    steps: NotRequired[Annotated[list[HelloStep], _default([], "What lock-step waits for.")]]
    wait_for: NotRequired[
        Annotated[list[str], _default([], "Nodes that must have subscribed before the play.")]
    ]


@_open
class HelloFaults(TypedDict):
    """What the job thinks of its stack's faults."""

    allow: NotRequired[Annotated[list[str], _default([], "Causes that end nothing.")]]


@_open
class HelloRecord(TypedDict):
    """What is recorded."""

    topics: NotRequired[
        Annotated[list[str], _default([], "Regular expressions that match whole topic names.")]
    ]
    byte_budget: NotRequired[
        Annotated[Natural, _default(1 << 30, "The most bytes of a recording.")]
    ]


@_open
class HelloDeadlines(TypedDict):
    """Seconds that each part of the case may take."""

    start: NotRequired[Annotated[Seconds, _default(30.0, "Until the rosmaster answers, if any.")]]
    subscribe: NotRequired[Annotated[Seconds, _default(20.0, "Until the stack subscribes.")]]
    drain: NotRequired[
        Annotated[Seconds, _default(10.0, "For what is under way after the last message.")]
    ]
    stop: NotRequired[Annotated[Seconds, _default(5.0, "Until the stack has ended when asked.")]]
    case: NotRequired[Annotated[Seconds, _default(600.0, "For everything.")]]


@_open
class HelloPublication(TypedDict):
    """A topic that a simulator speaks on."""

    topic: Annotated[str, Field(description="Its name.")]
    type: Annotated[str, Field(description="The message type's name.")]
    md5sum: Annotated[str, Field(description="The type's checksum.")]
    definition: Annotated[str, Field(description="The type's full text.")]
    latching: NotRequired[
        Annotated[bool, _default(False, "Whether late subscribers get the last message.")]
    ]
    recorded: NotRequired[Annotated[bool, _default(True, "Whether its messages are recorded.")]]


@_open
class HelloSimulator(TypedDict):
    """A simulator at the worker's end of the pipe."""

    publications: Annotated[
        list[HelloPublication], Field(description="By these places STEP names its topics.")
    ]


@_open
class HelloCase(TypedDict):
    """What to play, into what, and for how long at most."""

    id: Annotated[str, Field(description="The case's name, once in its job.")]
    job: NotRequired[Annotated[str, _default("", "Namespace and name of the job.")]]
    engine: NotRequired[
        Annotated[
            str,
            AfterValidator(_one_of_the_agent),
            Field(description="The agent's engine that runs it.", json_schema_extra=_engines_in),
        ]
    ]
    source: NotRequired[Annotated[str, _default("", "URI of the recording or the file.")]]
    window: HelloWindow
    topics: NotRequired[Annotated[list[str], _default([], "Topics to play; empty: all.")]]
    stack: HelloStack
    playback: NotRequired[Annotated[HelloPlayback, _default({}, "How messages are released.")]]
    faults: NotRequired[Annotated[HelloFaults, _default({}, "Which faults are allowed.")]]
    record: NotRequired[Annotated[HelloRecord, _default({}, "What is recorded.")]]
    deadlines: NotRequired[Annotated[HelloDeadlines, _default({}, "How long each part may take.")]]
    simulator: NotRequired[
        Annotated[HelloSimulator, Field(description="In place of a bag; only in lock-step.")]
    ]


def _simulated_in_lockstep(case: HelloCase) -> HelloCase:
    if "simulator" in case and case.get("playback", {}).get("mode") != "lockstep":
        raise ValueError("a simulator plays in lock-step only")
    return case


# The same as a schema says it.
_LOCKSTEP: Schema = {
    "if": {"required": ["simulator"]},
    "then": {
        "required": ["playback"],
        "properties": {
            "playback": {"required": ["mode"], "properties": {"mode": {"const": "lockstep"}}}
        },
    },
}


@functools.cache
def _adapter() -> TypeAdapter[HelloCase]:
    return TypeAdapter(Annotated[HelloCase, AfterValidator(_simulated_in_lockstep)])


def hello_case_schema() -> Schema:
    """The JSON Schema of the case."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "HelloCase"}
    return head | _adapter().json_schema() | _LOCKSTEP


def valid_case(value: object) -> HelloCase:
    """The case, if it has the shape. Raises pydantic.ValidationError."""
    return _adapter().validate_python(value, strict=True)
