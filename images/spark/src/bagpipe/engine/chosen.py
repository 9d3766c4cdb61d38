"""The object of the engine that a job names, in its folder's module `engine`."""

import importlib

from bagpipe.engine.engine import Engine
from bagpipe.engine_fields import EnginesError, engine_modules


def engine_of(name: str) -> Engine:
    """The engine that `stack.engine` names. Raises EnginesError."""
    module = f"{engine_modules()[name]}.engine"
    try:
        engine: Engine = importlib.import_module(module).ENGINE
    except Exception as error:  # an added engine's code may raise anything
        raise EnginesError.not_loaded(module, error) from error
    return engine
