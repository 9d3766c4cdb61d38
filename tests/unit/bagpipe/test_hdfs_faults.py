"""Which of a NameNode's answers are asked for again, and which are the end."""

import pytest

from bagpipe.storage.backend import TransientError
from bagpipe.storage.hdfs_faults import translated

STACK = "RPC error: org.apache.hadoop.hdfs.server.namenode.{}: Not now\n\tat org.apache.hadoop.X"


@pytest.mark.parametrize("name", ["NotReplicatedYetException", "SafeModeException"])
def test_what_passes_by_itself_is_asked_again(name: str) -> None:
    error = translated(RuntimeError(STACK.format(name)))
    assert isinstance(error, TransientError)
    assert str(error) == f"HDFS answered {name}"


def test_what_stays_is_the_end() -> None:
    error = translated(RuntimeError(STACK.format("LeaseExpiredException")))
    assert type(error) is OSError
    assert str(error) == "HDFS answered LeaseExpiredException"
