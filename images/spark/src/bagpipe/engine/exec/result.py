"""RESULT of a case of the exec engine."""

from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter
from typing_extensions import TypedDict  # pydantic asks for it before Python 3.12

from bagpipe.wire.maps.shape import Elapsed, Natural, open_map
from bagpipe.wire.maps.stack import StackEnd


@open_map
class ReturnedFile(TypedDict):
    """A file that the program gave back."""

    name: Annotated[str, Field(description="Its name.")]
    size: Annotated[Natural, Field(description="Its bytes.")]


@open_map
class ProgramTimings(TypedDict):
    """Seconds of each part of the case."""

    stack: Annotated[Elapsed, Field(description="Until the program was started.")]
    run: Annotated[Elapsed, Field(description="From its start to its END.")]
    stop: Annotated[Elapsed, Field(description="Until no process of it was left.")]


@open_map
class ProgramResult(TypedDict):
    """What came of a program's case."""

    engine: Annotated[Literal["exec"], Field(description="Which RESULT this is.")]
    stack: Annotated[StackEnd, Field(description="How the program ended.")]
    files: Annotated[
        list[ReturnedFile], Field(description="The files that came before, in their order.")
    ]
    bytes_in: Annotated[
        Natural,
        Field(description="Bytes of DATA written to the program: fewer if it closed stdin early."),
    ]
    bytes_out: Annotated[Natural, Field(description="Bytes of DATA that it gave back.")]
    records_in: Annotated[Natural, Field(description="FILEs written to the program.")]
    records_out: Annotated[Natural, Field(description="FILEs that it gave back.")]
    # What is not JSON in it is the program's fault, which judging it shows.
    program: Annotated[Any, Field(description="The program's own RESULT; nil where it sent none.")]
    timings: Annotated[ProgramTimings, Field(description="Seconds of each part of the case.")]


RESULT = TypeAdapter(ProgramResult)
