"""Fake drivers: KWOK's pods run nothing, so these answer `GET /progress` at their addresses.

KWOK gives pods addresses one after the other from a range of the loopback device, where one
server listens at each. A driver's count of passed cases grows by one every STEP seconds from the
moment its pod was seen running, so that a reader of the job's status knows how old it is. One case
fails, after a time that the address spreads: the first fault, which is not to wait for counts.
"""

import asyncio
import contextlib
import ipaddress
import json
import time
from collections.abc import AsyncIterator
from typing import Any

from bagpipe_operator.api.names import PROGRESS_PORT

# 127.64.0.0/14 holds the addresses of all fake pods; nothing else of a machine uses it.
POD_RANGE = ipaddress.ip_network("127.64.0.0/14")
STEP = 1.0
FIRST_FAULT, FAULTS_SPREAD = 5.0, 20.0
PLANNED = 100_000


def address(number: int) -> str:
    """The address of KWOK's pod number `number`, counted from 1."""
    return str(POD_RANGE[number])


def fault_after(at: str) -> float:
    """Seconds from a driver's begin to its one failed case; even over the addresses."""
    number = int(ipaddress.ip_address(at)) - int(POD_RANGE[0])
    return FIRST_FAULT + number * 0.618 % 1 * FAULTS_SPREAD


class FakeDrivers:
    """What the drivers answer; the address identifies the driver."""

    def __init__(self) -> None:
        self.running_since: dict[str, float] = {}  # by address, of time.monotonic
        self.connections: set[asyncio.Transport] = set()

    def account(self, at: str) -> bytes:
        """The driver's account as its HTTP server would send it."""
        since = self.running_since.get(at)
        age = 0.0 if since is None else time.monotonic() - since
        passed = int(age / STEP)
        failed = int(since is not None and age >= fault_after(at))
        progress = {
            "phase": "Running",
            "cases": {"planned": PLANNED, "running": 4, "passed": passed, "failed": failed},
            "ledger": {"sent": passed * 1000, "received": passed * 1000, "dropped": 0},
        }
        body = json.dumps(progress).encode()
        head = f"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: {len(body)}"
        return f"{head}\r\n\r\n".encode() + body


class _Connection(asyncio.Protocol):
    """One connection of the operator's: every request ends with an empty line and has no body."""

    def __init__(self, drivers: FakeDrivers) -> None:
        self._drivers = drivers
        self._received = b""
        self._transport: asyncio.Transport | None = None
        self._address = ""

    def connection_made(self, transport: Any) -> None:
        self._transport = transport
        self._drivers.connections.add(transport)
        self._address = transport.get_extra_info("sockname")[0]

    def connection_lost(self, _error: Exception | None) -> None:
        if self._transport is not None:
            self._drivers.connections.discard(self._transport)

    def data_received(self, data: bytes) -> None:
        self._received += data
        while b"\r\n\r\n" in self._received and self._transport is not None:
            _, self._received = self._received.split(b"\r\n\r\n", 1)
            self._transport.write(self._drivers.account(self._address))


@contextlib.asynccontextmanager
async def answering(count: int) -> AsyncIterator[FakeDrivers]:
    """Drivers at the first `count` addresses, until the block ends."""
    drivers = FakeDrivers()
    hosts = [address(number) for number in range(1, count + 1)]
    loop = asyncio.get_running_loop()
    server = await loop.create_server(lambda: _Connection(drivers), hosts, PROGRESS_PORT)
    try:
        yield drivers
    finally:
        server.close()
        for connection in list(drivers.connections):
            connection.abort()
        await server.wait_closed()
