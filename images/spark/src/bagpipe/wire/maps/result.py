"""What the RESULT of every engine has."""

from typing import Annotated

from pydantic import Field, TypeAdapter
from typing_extensions import TypedDict  # pydantic asks for it before Python 3.12

from bagpipe.wire.maps.shape import open_map
from bagpipe.wire.maps.stack import StackEnd


@open_map
class AnyResult(TypedDict):
    """The worker makes a row of it; the rest is the engine's, which compares it itself."""

    stack: Annotated[StackEnd, Field(description="How the software under test ended.")]


RESULT = TypeAdapter(AnyResult)
