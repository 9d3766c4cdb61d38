"""Prometheus as a process, Debian's unless another is named, with a configuration of the test's."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import urllib3
import yaml

from tests.integration.control_plane.server import DIES_WITH_US
from tests.integration.storage.servers import LOOPBACK, Host, Server
from tests.ports import free_port
from tests.waiting import PATIENCE


@dataclass
class Prometheus:
    """A running server; every question goes over its HTTP API."""

    server: Server
    port: int
    host: Host = LOOPBACK

    @classmethod
    def started(cls, folder: Path, targets: list[str], rules: Path) -> "Prometheus":
        """Asks its targets, and judges the rules, every other second."""
        scrapes = [{"job_name": "pods", "static_configs": [{"targets": targets}]}]
        return cls.configured(folder, scrapes, rules, LOOPBACK, free_port())

    @classmethod
    def configured(
        cls,
        folder: Path,
        scrapes: list[dict[str, Any]],
        rules: Path,
        host: Host,
        port: int,
        program: str = "prometheus",
    ) -> "Prometheus":
        """The same with whatever it is to find its targets by, on a host's port."""
        config = {
            "global": {
                "scrape_interval": "1s",
                "scrape_timeout": "900ms",
                "evaluation_interval": "2s",
            },
            "rule_files": [str(rules)],
            "scrape_configs": scrapes,
        }
        folder.mkdir()
        (folder / "prometheus.yaml").write_text(yaml.safe_dump(config))
        command = [
            *DIES_WITH_US,
            *host.command(
                program, f"--config.file={folder / 'prometheus.yaml'}",
                f"--storage.tsdb.path={folder / 'data'}",
                f"--web.listen-address={host.address}:{port}",
            ),
        ]  # fmt: skip
        made = cls(Server(command, folder / "prometheus.log"), port, host)
        made.server.start()
        made.server.await_ready(made._ready, PATIENCE)
        return made

    def get(self, path: str, **fields: str) -> Any:
        """What the API answers to a question."""
        url = f"http://{self.host.address}:{self.port}/api/v1/{path}"
        answer = urllib3.request("GET", url, fields=fields, timeout=30, retries=False).json()
        assert answer["status"] == "success", answer
        return answer["data"]

    def values(self, expression: str) -> list[float]:
        """The numbers that an expression yields at this moment."""
        found = self.get("query", query=expression)["result"]
        values = [float(sample["value"][1]) for sample in found]
        return [value for value in values if not math.isnan(value)]

    def up(self) -> int:
        """How many targets answer."""
        return sum(value == 1 for value in self.values("up"))

    def _ready(self) -> bool:
        try:
            url = f"http://{self.host.address}:{self.port}/-/ready"
            return urllib3.request("GET", url, timeout=20, retries=False).status == 200
        except urllib3.exceptions.HTTPError:
            return False
