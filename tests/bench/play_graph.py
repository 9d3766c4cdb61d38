"""A ROS graph for the play bench: Debian's rosmaster, nodes compiled here, bags made here.

Everything that is started is ended when the graph is left; every wait has a deadline.
"""

import contextlib
import hashlib
import os
import queue
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

HERE = Path(__file__).parent
NODES = HERE / "nodes"
ROOT = HERE.parent.parent
CACHE = Path(os.environ.get("BAGPIPE_CACHE", Path.home() / ".cache" / "bagpipe")) / "bench"
PYTHON = "/usr/bin/python3"
PATIENCE = 60.0
LIBRARIES = [
    f"-l{name}"
    for name in (
        *("roscpp", "rosconsole", "roscpp_serialization", "rostime", "xmlrpcpp", "cpp_common"),
        *("boost_system", "boost_thread", "pthread"),
    )
]


class Node:
    """A running program and the lines that it prints."""

    def __init__(self, command: list[str], environment: dict[str, str], folder: Path) -> None:
        self.name = Path(command[0]).name
        self.process = subprocess.Popen(
            command,
            env=environment,
            cwd=folder,
            text=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        self.lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self.output: list[str] = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.put(line.rstrip("\n"))
        self.lines.put(None)

    def wait_for(self, word: str, patience: float = PATIENCE) -> str:
        """The first line that begins with a word."""
        deadline = time.monotonic() + patience
        while True:
            try:
                line = self.lines.get(timeout=max(deadline - time.monotonic(), 0.001))
            except queue.Empty:
                line = None
            if line is None:
                output = "\n".join(self.output[-20:])
                raise RuntimeError(f"{self.name} never wrote {word!r}; its output:\n{output}")
            self.output.append(line)
            if line.startswith(word):
                return line

    def end(self, by: signal.Signals = signal.SIGINT, patience: float = PATIENCE) -> None:
        """Asks it to end and waits."""
        self.process.send_signal(by)
        self.process.wait(patience)

    def kill(self) -> None:
        """Ends it and what it started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait(PATIENCE)


class Graph:
    """A master and its nodes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.nodes: list[Node] = []
        with socket.create_server(("127.0.0.1", 0)) as probe:
            self.port: int = probe.getsockname()[1]
        self.environment = {
            **os.environ,
            "ROS_MASTER_URI": f"http://127.0.0.1:{self.port}/",
            "ROS_IP": "127.0.0.1",
            "ROS_HOME": str(folder),
            "ROS_LOG_DIR": str(folder),
            "PYTHONUNBUFFERED": "1",
        }

    def start(self, *command: str | Path) -> Node:
        """Starts a program in the graph."""
        node = Node([str(part) for part in command], self.environment, self.folder)
        self.nodes.append(node)
        return node

    def run(self, *command: str | Path) -> str:
        """Runs a program in the graph to its end; what it printed."""
        words = [str(part) for part in command]
        done = subprocess.run(
            words,
            env=self.environment,
            cwd=self.folder,
            text=True,
            capture_output=True,
            timeout=120,
            check=False,
        )
        if done.returncode != 0:
            raise RuntimeError(f"{words}: {done.stdout}{done.stderr}")
        return done.stdout

    def end_all(self) -> None:
        """Ends every node."""
        for node in reversed(self.nodes):
            node.kill()
        self.nodes.clear()


@contextlib.contextmanager
def graph(folder: Path) -> Iterator[Graph]:
    """A fresh graph, whose master answers."""
    new = Graph(folder)
    new.start("/usr/bin/rosmaster", "--core", "-p", str(new.port))
    deadline = time.monotonic() + PATIENCE
    pause = threading.Event()
    try:
        while True:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", new.port)):
                break
            if time.monotonic() > deadline:
                raise RuntimeError("rosmaster does not answer")
            pause.wait(0.02)
        yield new
    finally:
        new.end_all()


def compiled(name: str) -> Path:
    """A C++ node, compiled once for each of its texts."""
    source = NODES / f"{name}.cpp"
    mark = hashlib.sha256(source.read_bytes()).hexdigest()[:16]
    binary = CACHE / f"{name}-{mark}"
    if not binary.exists():
        CACHE.mkdir(parents=True, exist_ok=True)
        command = ["g++", "-O2", "-o", str(binary), str(source), *LIBRARIES]
        subprocess.run(command, check=True)
    return binary


def agent() -> Path:
    """The release build of the agent, or the one that BAGPIPE_AGENT names."""
    if given := os.environ.get("BAGPIPE_AGENT"):
        return Path(given)
    target = "x86_64-unknown-linux-gnu"
    folder = Path(os.environ.get("CARGO_TARGET_DIR", CACHE.parent / "cargo"))
    command = ["cargo", "build", "--locked", "--release", "-p", "bagpipe-agent"]
    environment = {
        **os.environ,
        "CARGO_TARGET_DIR": str(folder),
        "RUSTFLAGS": "-C target-feature=+crt-static",
    }
    command += ["--target", target, "--quiet"]
    subprocess.run(command, check=True, cwd=ROOT / "images/agent", env=environment)
    return folder / target / "release" / "bagpipe-agent"


def bag(folder: Path, size: int, messages: int) -> Path:
    """A bag of so many messages of so many bytes."""
    path = folder / f"{size}x{messages}.bag"
    if not path.exists():
        command = [PYTHON, str(NODES / "make_bag.py"), str(path), str(size), str(messages)]
        subprocess.run(command, check=True)
    return path
