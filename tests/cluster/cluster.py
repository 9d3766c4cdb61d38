"""The embedded Kubernetes of Bagpipe's demonstrations and tests.

Usage: python3 tests/cluster/cluster.py VERB [ARGUMENT...]

    up                  start it (at once if it is up)
    down                remove all of it
    status              is it healthy?
    load [IMAGE...]     give it images (all that are built)
    kubeconfig          print the path of its kubeconfig
    tools               print a folder with kubectl and helm
    preflight [SET...]  check the machine and install what is needed
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable

from embedded import images, lifecycle, preflight, tools
from embedded.failure import ClusterError
from embedded.places import KUBECONFIG, LOGS

PREFLIGHT = "`make preflight` installs the programs that the cluster needs."


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "verb", choices=["up", "down", "status", "load", "kubeconfig", "tools", "preflight"]
    )
    parser.add_argument("arguments", nargs="*")
    given = parser.parse_args()
    verbs: dict[str, Callable[[], object]] = {
        "up": lifecycle.up,
        "down": lifecycle.down,
        "status": lifecycle.status,
        "load": lambda: images.load(given.arguments),
        "kubeconfig": lambda: print(KUBECONFIG),
        "tools": lambda: print(tools.link()),
        "preflight": lambda: preflight.run(given.arguments),
    }
    try:
        if given.verb in {"up", "down", "load"} and os.geteuid():
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
