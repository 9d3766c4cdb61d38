"""The object of the engine that a job names, in its folder's module `engine`."""

from bagpipe.engine.engine import Engine
from bagpipe.engine_fields import of_engine


def engine_of(name: str) -> Engine:
    """The engine that `stack.engine` names. Raises InstallationError."""
    engine: Engine = of_engine(name, "engine")
    return engine
