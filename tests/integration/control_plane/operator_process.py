"""`bagpipe-operator` of this checkout as a real process, which tests may kill."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import urllib3

from tests.integration.control_plane.server import DIES_WITH_US
from tests.integration.storage.servers import Server
from tests.ports import free_port
from tests.waiting import PATIENCE

PROGRAM = Path(sys.executable).with_name("bagpipe-operator")
# An answer is asked for once, so it may take its time.
ANSWER_SECONDS = 20.0


@dataclass
class OperatorProcess:
    """One operator. Its log is `server.log`, kept over restarts."""

    kubeconfig: Path
    log: Path
    environment: dict[str, str] = field(default_factory=dict)
    # Removes the Lease that one which was killed has left, as if its time were over: to wait for
    # that is what the tests of replicas are for.
    forget_lease: Callable[[], None] | None = None
    port: int = field(default_factory=free_port)
    server: Server = field(init=False)
    _killed: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        defaults = {
            "KUBECONFIG": str(self.kubeconfig),
            "BAGPIPE_LISTEN_HOST": "127.0.0.1",
            "BAGPIPE_LISTEN_PORT": str(self.port),
            "BAGPIPE_SWEEP_SECONDS": "0.5",
            # Claims that are not there end no job while a test is slow.
            "BAGPIPE_STUCK_SECONDS": str(10 * PATIENCE),
        }
        self.server = Server([*DIES_WITH_US, str(PROGRAM)], self.log, defaults | self.environment)

    def start(self, ready_seconds: float = PATIENCE) -> "OperatorProcess":
        """Starts it, again after it has ended, and waits until /readyz says yes."""
        if self._killed and self.forget_lease:
            self.forget_lease()
        self._killed = False
        self.server.start()
        self.server.await_ready(lambda: self.ask("/readyz")[0] == 200, ready_seconds)
        return self

    def kill(self) -> None:
        """SIGKILL: it can't say or finish anything."""
        self.server.kill()
        self._killed = True

    def ended(self) -> int | None:
        """Its exit status, negative for a signal; None while it runs."""
        return self._process.poll()

    def terminate(self) -> int:
        """SIGTERM, as a kubelet sends it; the exit status."""
        return self._signalled(signal.SIGTERM)

    def pause(self) -> None:
        """SIGSTOP: all its clocks go on while it does nothing."""
        self._process.send_signal(signal.SIGSTOP)

    def resume(self) -> None:
        """SIGCONT."""
        self._process.send_signal(signal.SIGCONT)

    def ask(self, path: str) -> tuple[int, str]:
        """Status and text of /livez, /readyz or /metrics; status 0 when nobody answers."""
        try:
            answer = urllib3.request(
                "GET", f"http://127.0.0.1:{self.port}{path}", timeout=ANSWER_SECONDS, retries=False
            )
        except urllib3.exceptions.HTTPError:
            return 0, ""
        return answer.status, answer.data.decode()

    def metric(self, name: str) -> float | None:
        """A sample of /metrics by its whole name with labels; None when it is not there."""
        for line in self.ask("/metrics")[1].splitlines():
            if line.startswith(f"{name} "):
                return float(line.split()[-1])
        return None

    def logged(self) -> str:
        """Its log."""
        return self.log.read_text(errors="replace")

    @property
    def _process(self) -> subprocess.Popen[bytes]:
        process = self.server._process
        assert process is not None, "the operator was never started"
        return process

    def _signalled(self, number: signal.Signals) -> int:
        self._process.send_signal(number)
        return self._process.wait(timeout=PATIENCE)


def rendered(
    helm_values: list[str], namespace: str, templates: list[str], chart: str = "bagpipe"
) -> str:
    """Templates of a chart as Helm renders them for a release in `namespace`, as YAML."""
    root = Path(__file__).parents[3]
    shown = [word for name in templates for word in ("--show-only", f"templates/{name}")]
    settings = [word for value in helm_values for word in ("--set-json", value)]
    done = subprocess.run(
        ["helm", "template", "bagpipe", str(root / "charts" / chart), "--namespace", namespace,
         "--kube-version", "1.34.4", *shown, *settings],
        capture_output=True, text=True, timeout=60, check=False, env=dict(os.environ),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout
