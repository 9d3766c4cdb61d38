"""The one place that asks which engine a job has."""

from bagpipe.engine.engine import Engine
from bagpipe.engine.exec import Exec
from bagpipe.engine.ros1 import Ros1

ENGINES: dict[str, Engine] = {"ros1": Ros1(), "exec": Exec()}


def engine_of(name: str) -> Engine:
    """The engine that `stack.engine` names."""
    return ENGINES[name]
