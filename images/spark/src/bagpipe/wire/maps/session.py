"""The maps that begin, accompany and end a session."""

from typing import Annotated, NotRequired

from pydantic import Field, JsonValue, Strict, TypeAdapter
from typing_extensions import TypedDict  # pydantic asks for it before Python 3.12

from bagpipe.wire.maps.shape import Checksum, Natural, Number, Signed, default, open_map

Session = Annotated[str, Field(pattern="^[0-9a-fA-F]{32}$")]
Range = Annotated[tuple[Natural, Natural, Natural], Strict(False)]  # MessagePack has only lists
_PROTOCOL = "The protocol's number, 1."


@open_map
class WorkerHello(TypedDict):
    """The worker's first frame."""

    session: Annotated[Session, Field(description="32 hexadecimal digits of no other session.")]
    protocol: Annotated[Checksum, Field(description=_PROTOCOL)]
    software: NotRequired[Annotated[str, default("", "Name and version of the worker.")]]
    case: Annotated[dict[str, JsonValue], Field(description="[The case](#the-case).")]


@open_map
class AgentHello(TypedDict):
    """The agent's first frame."""

    session: Annotated[str, Field(description="As the worker's HELLO has it.")]
    protocol: Annotated[Checksum, Field(description=_PROTOCOL)]
    software: Annotated[str, Field(description="Name and version of the agent.")]
    pipe_bytes: Annotated[
        Natural, Field(description="Size of the pipe to the agent, as the kernel granted it.")
    ]


@open_map
class FileToAgent(TypedDict):
    """The head of a file for the agent."""

    name: Annotated[str, Field(description="The file's name.")]
    size: Annotated[Natural, Field(description="Bytes of DATA that follow.")]
    ranges: NotRequired[
        Annotated[
            list[Range],
            default(
                [],
                "Which bytes of the stream lie where in the file `name`: offset in the stream,"
                " offset in the file, length; in bytes.",
            ),
        ]
    ]


@open_map
class FileFromAgent(TypedDict):
    """The head of a file from the agent: its recording, or what a program gave back."""

    name: Annotated[str, Field(description="The file's name.")]
    size: NotRequired[
        Annotated[
            Natural | None,
            default(None, "Bytes of DATA that follow; nil where a program does not know yet."),
        ]
    ]


@open_map
class Metric(TypedDict):
    """Progress of a replay. The METRIC of a program is its own; the worker reads neither."""

    stage: Annotated[str, Field(description="`subscribe`, `lead_in`, `play` or `drain`.")]
    sent: Annotated[Natural, Field(description="Messages played so far, the lead-in included.")]
    recorded: Annotated[Natural, Field(description="Messages recorded so far.")]
    bag_seconds: Annotated[
        Number, Field(description="Seconds of bag time since the beginning of the lead-in.")
    ]


@open_map
class End(TypedDict):
    """The totals of one direction, which prove that nothing is missing."""

    files: Annotated[Natural, Field(description="FILE frames.")]
    bytes: Annotated[Natural, Field(description="Bytes of DATA.")]
    digest: Annotated[
        Checksum,
        Field(
            description="CRC-32C over the crc32c fields (4 bytes each, as on the wire) of all"
            " frames of this direction before END."
        ),
    ]


@open_map
class Abort(TypedDict):
    """Why there will be no END."""

    reason: Annotated[str, Field(description="In CamelCase.")]
    message: Annotated[str, Field(description="A sentence for people.")]
    exit_status: NotRequired[
        Annotated[
            Signed | None,
            default(None, "Of the program in question; nil where it has none."),
        ]
    ]
    signal: NotRequired[
        Annotated[Signed | None, default(None, "The signal that ended it; nil where none did.")]
    ]
    stderr: NotRequired[Annotated[list[str], default([], "Its last lines on stderr.")]]
    stdout: NotRequired[Annotated[list[str], default([], "Its last lines on stdout.")]]
    session: NotRequired[
        Annotated[str, default("", "The session that is aborted, where it is known.")]
    ]


HELLO = TypeAdapter(AgentHello)
FILE = TypeAdapter(FileFromAgent)
END = TypeAdapter(End)
ABORT = TypeAdapter(Abort)
