"""Ports for the rosmasters of this machine's slots, which no other run here takes meanwhile."""

import errno
import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

# Beside ROS' own 11311, below what the kernel hands out; each run takes a step or less of them.
FIRST, END, STEP = 21311, 31311, 97


class NoPortsError(Exception):
    """No neighbouring ports of this machine are free; the sentence says how many were wanted."""


@contextmanager
def master_ports(count: int) -> Iterator[int]:
    """The first of `count` neighbouring free ports of loopback, kept from others for the block.

    Nothing listens there before a case runs, so that they are free is not enough: who takes them
    holds the name of an abstract socket (unix(7)), which the kernel gives to one process of this
    network namespace and takes back when that ends. Raises NoPortsError where there are none.
    """
    for first in _in_turn(list(range(FIRST, END, STEP))):
        with ExitStack() as held:
            if _hold(held, first) and all(_is_free(port) for port in range(first, first + count)):
                yield first
                return
    raise NoPortsError(f"no {count} neighbouring ports are free for the rosmasters: end what runs")


def _in_turn(ports: list[int]) -> list[int]:
    """Another process begins elsewhere: what one that was killed has started may still end."""
    begin = os.getpid() % len(ports)
    return ports[begin:] + ports[:begin]


def _hold(held: ExitStack, first: int) -> bool:
    name = held.enter_context(socket.socket(socket.AF_UNIX))
    try:
        name.bind(f"\0bagpipe-master-ports-{first}")
    except OSError as error:
        # Where such names are not to be had, that the ports are free must do.
        return error.errno != errno.EADDRINUSE
    return True


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
        return True
