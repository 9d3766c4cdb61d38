"""Ports of loopback for servers of tests, of which no two runs of tests take the same."""

import random
import socket

from bagpipe.run.master_ports import FIRST

# Below those that the kernel hands out by itself: one of these could be taken before its server
# listens, or while the server is down between two starts. Between those of the agent's own tests
# (12000 to 19999, in Rust) and those of the rosmasters.
_PORTS = range(20_000, FIRST)
_held: list[socket.socket] = []


def free_port() -> int:
    """A port that nothing listens on now, each time another one, also in another process."""
    for port in random.SystemRandom().sample(_PORTS, len(_PORTS)):
        if _hold(port) and _is_free(port):
            return port
    raise AssertionError("no free port of loopback is left for a test")


def _hold(port: int) -> bool:
    """Whether this process has the port now, which it keeps until it ends (see master_ports)."""
    name = socket.socket(socket.AF_UNIX)
    try:
        name.bind(f"\0bagpipe-test-port-{port}")
    except OSError:
        name.close()
        return False
    _held.append(name)
    return True


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
        return True
