"""Which RESULT an engine of the agent answers with."""

import functools
from typing import Annotated, Any

from pydantic import Field, TypeAdapter
from typing_extensions import TypedDict  # pydantic asks for it before Python 3.12

from bagpipe.engine_fields import DEFAULT_ENGINE
from bagpipe.wire.maps.program import ProgramResult
from bagpipe.wire.maps.replay import ReplayResult
from bagpipe.wire.maps.shape import check, open_map
from bagpipe.wire.maps.stack import StackEnd


@open_map
class AnyResult(TypedDict):
    """What every engine's has: the worker makes a row of it."""

    stack: Annotated[StackEnd, Field(description="How the software under test ended.")]


MODELS: dict[str, Any] = {"ros1": ReplayResult, "exec": ProgramResult}


@functools.cache
def _model(engine: str) -> TypeAdapter[Any]:
    return TypeAdapter(MODELS.get(engine, AnyResult))


def check_result(engine: object, fields: dict[str, Any]) -> None:
    """Compares RESULT with what the agent's engine that HELLO named writes. Raises MapError."""
    check("RESULT", _model(str(engine or DEFAULT_ENGINE)), fields)
