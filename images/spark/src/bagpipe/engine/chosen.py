"""The object of the engine that a job names, in its folder's module `engine`."""

import importlib

from bagpipe.engine.engine import Engine
from bagpipe.engine_fields import engine_modules


def engine_of(name: str) -> Engine:
    """The engine that `stack.engine` names."""
    engine: Engine = importlib.import_module(f"{engine_modules()[name]}.engine").ENGINE
    return engine
