"""How the software under test ended, and what it used: a part of each engine's RESULT."""

from typing import Annotated, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict  # pydantic asks for it before Python 3.12

from bagpipe.wire.maps.shape import Elapsed, Natural, Number, Signed, default, open_map


@open_map
class Usage(TypedDict):
    """What all processes of the stack used."""

    seconds: Annotated[
        Elapsed,
        Field(description="Seconds from the command's start until its last process was gone."),
    ]
    cpu_seconds: Annotated[
        Elapsed, Field(description="Seconds of user and system time, of ended processes too.")
    ]
    peak_memory_bytes: Annotated[
        Natural, Field(description="The greatest sum of resident sets that was seen, in bytes.")
    ]


@open_map
class Ended(TypedDict):
    """One end of a process or node that is evidence."""

    cause: Annotated[
        Literal["StackCrashed", "StackExited", "NodeGone", "NodeRespawned"],
        Field(description="[When which](#how-the-stack-ended)."),
    ]
    what: Annotated[Literal["command", "process", "node"], Field(description="What ended.")]
    name: Annotated[str, Field(description="Of the program or the node.")]
    exit_status: Annotated[
        Signed | None, Field(description="Nil where a signal ended it, or it is unknown.")
    ]
    signal: Annotated[
        Signed | None, Field(description="Nil where none ended it, or it is unknown.")
    ]
    bag_seconds: Annotated[
        Number | None,
        Field(
            description="When: seconds since the window's start, negative in the lead-in; nil where"
            " it is unknown and before anything was played."
        ),
    ]
    message: Annotated[str, Field(description="The same as a sentence.")]


@open_map
class StackEnd(TypedDict):
    """How the command ended."""

    exit_status: Annotated[
        Signed | None, Field(description="Of the command; nil where a signal ended it.")
    ]
    signal: Annotated[
        Signed | None, Field(description="What ended the command; nil where it exited.")
    ]
    stderr: Annotated[list[str], Field(description="Its last lines on stderr.")]
    stdout: Annotated[list[str], Field(description="Its last lines on stdout.")]
    ended_by: Annotated[
        Literal["agent", "itself"],
        Field(description="`itself` where it had ended before the agent asked it to."),
    ]
    usage: Annotated[
        Usage | None, Field(description="What it used; nil where that was not measured.")
    ]
    ended: Annotated[
        list[Ended],
        Field(description="Each end that is evidence, in order of time; mostly none."),
    ]
    left: NotRequired[
        Annotated[
            list[str],
            default(
                [],
                "Nodes that left the graph after all input was out, and whose processes lived on:"
                " [with a loss](#how-the-stack-ended), one is `NodeGone`.",
            ),
        ]
    ]
