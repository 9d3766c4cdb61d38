"""Real storage servers as processes that a test may kill and start again.

They serve loopback, or an address of a network namespace that others reach (see Host).
"""

import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from tests.ports import free_port
from tests.waiting import PATIENCE

ACCESS_KEY = "bagpipe-tests"
SECRET_KEY = "a-secret-that-nobody-may-ever-read"  # noqa: S105  of a server for tests
BUCKET = "recordings"


def listens(port: int, address: str = "127.0.0.1") -> bool:
    """Whether something accepts connections on a port."""
    with socket.socket() as probe:
        probe.settimeout(1)
        return probe.connect_ex((address, port)) == 0


@dataclass(frozen=True)
class Host:
    """Where servers run: an address that tests reach, and the network namespace that has it."""

    address: str = "127.0.0.1"
    namespace: Path | None = None

    def command(self, *command: str) -> list[str]:
        """The command as it runs there."""
        entering = [] if self.namespace is None else ["nsenter", f"--net={self.namespace}"]
        return [*entering, *command]


LOOPBACK = Host()


@dataclass
class Server:
    """One process, with its log; it is the leader of its own session."""

    command: list[str]
    log: Path
    environment: dict[str, str] = field(default_factory=dict)
    folder: Path | None = None
    _process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it, again after `kill`."""
        with self.log.open("ab") as output:
            self._process = subprocess.Popen(
                self.command,
                env={**os.environ, **self.environment},
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def alive(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def kill(self) -> None:
        """End it at once, without a word to its clients' connections."""
        if self._process is not None:
            self._process.send_signal(signal.SIGKILL)
            self._process.wait(timeout=PATIENCE)

    def await_ready(self, ready: Callable[[], bool], seconds: float) -> None:
        """Wait until it serves; fails with the end of its log."""
        deadline = time.monotonic() + seconds
        pause = threading.Event()
        while not ready():
            log = self.log.read_text()[-4000:]
            assert self.alive, log
            assert time.monotonic() < deadline, log
            pause.wait(0.05)


@dataclass
class S3Server:
    """versitygw over a folder; each sub-folder is a bucket."""

    server: Server
    root: Path
    port: int
    host: Host = LOOPBACK

    @property
    def url(self) -> str:
        return f"http://{self.host.address}:{self.port}"

    def start(self) -> None:
        self.server.start()
        self.server.await_ready(lambda: listens(self.port, self.host.address), PATIENCE)

    def kill(self) -> None:
        self.server.kill()


def s3_server(
    binary: Path, folder: Path, host: Host = LOOPBACK, port: int | None = None
) -> S3Server:
    """A server, not yet started; without a port one of loopback that is free."""
    root = folder / "s3"
    (root / BUCKET).mkdir(parents=True)
    port = port or free_port()
    place = f"{host.address}:{port}"
    command = host.command(str(binary), "--quiet", "--port", place, "posix", str(root))
    keys = {"ROOT_ACCESS_KEY": ACCESS_KEY, "ROOT_SECRET_KEY": SECRET_KEY}
    return S3Server(Server(command, folder / "s3.log", keys), root, port, host)
