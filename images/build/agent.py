"""Build the static agent and print where it is.

    python3 images/build/agent.py

It is the program of the agent's image, and the one that `bagpipe run` needs on a laptop.
"""

from __future__ import annotations

import sys

from context import agent_binary
from failure import BuildError


def main() -> int:
    try:
        print(f"  {agent_binary()}")
    except BuildError as error:
        print(f"Building the agent failed. {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
