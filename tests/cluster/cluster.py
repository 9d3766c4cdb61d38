"""The embedded Kubernetes of Bagpipe's demonstrations and tests.

    python3 tests/cluster/cluster.py up                 start it (at once if it is up)
    python3 tests/cluster/cluster.py down               remove all of it
    python3 tests/cluster/cluster.py status             is it healthy?
    python3 tests/cluster/cluster.py load [IMAGE...]    give it images (all that are built)
    python3 tests/cluster/cluster.py kubeconfig         print the path of its kubeconfig
    python3 tests/cluster/cluster.py tools              print a folder with kubectl and helm
    python3 tests/cluster/cluster.py preflight [SET...] check and install what is needed
"""

from __future__ import annotations

import argparse
import sys

from embedded import images, lifecycle, preflight, tools
from embedded.failure import ClusterError
from embedded.places import KUBECONFIG


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "verb", choices=["up", "down", "status", "load", "kubeconfig", "tools", "preflight"]
    )
    parser.add_argument("arguments", nargs="*")
    given = parser.parse_args()
    verbs = {
        "up": lifecycle.up,
        "down": lifecycle.down,
        "status": lifecycle.status,
        "load": lambda: images.load(given.arguments),
        "kubeconfig": lambda: print(KUBECONFIG),
        "tools": lambda: print(tools.link()),
        "preflight": lambda: preflight.run(given.arguments),
    }
    try:
        verbs[given.verb]()
    except ClusterError as error:
        print(f"cluster {given.verb} failed: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"cluster {given.verb} was interrupted; it can be run again.", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
