"""Cases without end through the slot of an agent: the real recording, the real node.

    agent_cases.py FOLDER SHARED

In real time and in lock-step by turns, until the process is killed.
"""

import itertools
import sys
from pathlib import Path

from bagpipe.run.case_run import RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from tests.integration.stacks import folders_with_recording, in_one_piece, spec_with


def main(folder: Path, shared: str) -> None:
    """Runs them."""
    folders = folders_with_recording(folder)
    specs = (spec_with({"mode": "realtime", "rate": 4.0}), in_one_piece())
    for spec in itertools.cycle(specs):
        context = RunContext("lab/pr2", spec, folders, "pvc://results/r", shared)
        row = run_case(plan(spec, Storage(folders)).cases[0], context)
        print(spec.playback.mode, row["outcome"], row["reason"], row["seconds"], flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
