"""Only reads a socket: a TCPROS subscriber of a topic, or of a bare connection.

sink.py topic <name> <bytes> | sink.py port <bytes>
Prints "port N" or "ready", then "received BYTES seconds S".
"""

import os
import socket
import struct
import sys
import threading
import time
from xmlrpc.client import ServerProxy
from xmlrpc.server import SimpleXMLRPCServer

NAME = f"/sink_{os.getpid()}"


def say(line: str) -> None:
    """One whole line, at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def drain(stream: socket.socket, expected: int) -> None:
    """Reads, and says how long it took from the first byte to the last."""
    buffer = bytearray(1 << 20)
    received = stream.recv_into(buffer)
    begun = ended = time.perf_counter()
    while received < expected:
        count = stream.recv_into(buffer)
        if count == 0:
            break
        received += count
        ended = time.perf_counter()
    say(f"received {received} seconds {ended - begun:.9f}")
    # Stays connected, so that the publisher sees no broken connection.
    threading.Event().wait()


def exactly(stream: socket.socket, count: int) -> bytes:
    """Reads so many bytes."""
    data = b""
    while len(data) < count:
        part = stream.recv(count - len(data))
        if not part:
            raise ConnectionError("the publisher hung up")
        data += part
    return data


class Slave:
    """As much of a node's API as a publisher and a master need."""

    def __init__(self) -> None:
        self.publisher = threading.Event()
        self.uri = ""

    def publisherUpdate(self, _caller: str, _topic: str, uris: list[str]) -> list[object]:  # noqa: N802
        """The master says who publishes."""
        if uris:
            self.uri = uris[0]
            self.publisher.set()
        return [1, "", 0]

    def getBusStats(self, _caller: str) -> list[object]:  # noqa: N802
        """It has no statistics: it only reads."""
        return [1, "", [[], [], []]]

    def getBusInfo(self, _caller: str) -> list[object]:  # noqa: N802
        """As above."""
        return [1, "", []]


def subscribe(topic: str) -> socket.socket:
    """Registers, waits for the publisher and shakes hands."""
    slave = Slave()
    server = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False, allow_none=True)
    server.register_instance(slave)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    uri = f"http://127.0.0.1:{server.server_address[1]}/"
    ServerProxy(os.environ["ROS_MASTER_URI"]).registerSubscriber(NAME, topic, "*", uri)
    say("ready")
    slave.publisher.wait(30)
    answer = ServerProxy(slave.uri).requestTopic(NAME, topic, [["TCPROS"]])
    _protocol, host, port = answer[2]
    stream = socket.create_connection((host, port))
    fields = {"callerid": NAME, "topic": topic, "type": "*", "md5sum": "*"}
    parts = [f"{key}={value}".encode() for key, value in fields.items()]
    header = b"".join(struct.pack("<I", len(part)) + part for part in parts)
    stream.sendall(struct.pack("<I", len(header)) + header)
    exactly(stream, struct.unpack("<I", exactly(stream, 4))[0])
    return stream


if sys.argv[1] == "topic":
    drain(subscribe(sys.argv[2]), int(sys.argv[3]))
else:
    listener = socket.create_server(("127.0.0.1", 0))
    say(f"port {listener.getsockname()[1]}")
    drain(listener.accept()[0], int(sys.argv[2]))
