"""The embedded Kubernetes of Bagpipe's demonstrations and tests.

Usage: python3 tests/cluster/cluster.py VERB [ARGUMENT...]

    up [--nodes N]      start it (at once if it is up), with N nodes
    down                remove all of it
    status              is it healthy? its nodes and daemons
    cut NODE...         pull a node's cable to the others
    join NODE...        put it in again
    load [IMAGE...]     give it images (all that are built)
    kubeconfig          print the path of its kubeconfig
    tools               print a folder with kubectl and helm
    build PROGRAM...    build programs of the tests from their Go modules, unless the cache has them
    check               say what the machine lacks that can't be installed for you
    preflight [SET...]  check the machine and install what is needed
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable

from embedded import builds, faults, images, lifecycle, preflight, tools
from embedded.failure import ClusterError
from embedded.places import KUBECONFIG, LOGS, MOST_NODES

VERBS = ["up", "down", "status", "cut", "join", "load", "kubeconfig", "tools", "build",
         "check", "preflight"]  # fmt: skip
PREFLIGHT = "`make preflight` installs the programs that the cluster needs."


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("verb", choices=VERBS)
    parser.add_argument("arguments", nargs="*")
    parser.add_argument("--nodes", type=int, choices=range(1, MOST_NODES + 1), metavar="N")
    given = parser.parse_args()
    verbs: dict[str, Callable[[], object]] = {
        "up": lambda: lifecycle.up(given.nodes),
        "down": lifecycle.down,
        "status": lifecycle.status,
        "cut": lambda: list(map(faults.cut_off, given.arguments)),
        "join": lambda: list(map(faults.join, given.arguments)),
        "load": lambda: images.load(given.arguments),
        "kubeconfig": lambda: print(KUBECONFIG),
        "tools": lambda: print(tools.link()),
        "build": lambda: list(map(builds.ensure, map(builds.named, given.arguments))),
        "check": preflight.check,
        "preflight": lambda: preflight.run(given.arguments),
    }
    try:
        if given.verb in {"up", "down", "load", "cut", "join"} and os.geteuid():
            raise ClusterError("namespaces, mounts and containers need root (try sudo).")
        verbs[given.verb]()
    except FileNotFoundError as error:
        print(f"cluster {given.verb} failed: {error}. {PREFLIGHT}", file=sys.stderr)
        return 1
    except ClusterError as error:
        print(f"cluster {given.verb} failed: {error}", file=sys.stderr)
        if given.verb == "up":
            print(f"All logs are in {LOGS}; `make down` removes what was started.", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"cluster {given.verb} was interrupted; it can be run again.", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
