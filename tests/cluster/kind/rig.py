"""Runs a command where kind can be used: `python3 -m kind.rig make demo CLUSTER=kind`.

The command finds in DOCKER_HOST an engine that starts for it, and in KIND_IMAGE a node's image.
Clusters and kind's network end with it; images stay in the engine's folder for the next time.
"""

from __future__ import annotations

import subprocess
import sys

from embedded.failure import ClusterError

from . import engine, node

NETWORK = "kind"
# Of kind's: all nodes of its clusters have it.
LABEL = "io.x-k8s.kind.cluster"


def remove_clusters() -> None:
    """Nodes with their volumes, and the network, whose link would stay when the engine ends."""
    listed = node.run("docker", "ps", "--all", "--quiet", "--filter", f"label={LABEL}").split()
    if listed:
        node.run("docker", "rm", "--force", "--volumes", *listed)
    if node.run("docker", "network", "ls", "--quiet", "--filter", f"name=^{NETWORK}$"):
        node.run("docker", "network", "rm", NETWORK)


def run(command: list[str]) -> int:
    with engine.running():
        try:
            environment = {**engine.environment(), "KIND_IMAGE": node.make()}
            return subprocess.run(command, env=environment, check=False).returncode
        finally:
            remove_clusters()


def main() -> int:
    try:
        return run(sys.argv[1:])
    except ClusterError as error:
        print(f"kind's rig failed: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
