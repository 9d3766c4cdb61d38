"""The demonstration's job without Kubernetes: `bagpipe run`, as on a laptop.

`make demo` calls it as soon as it can, while the cluster is still being built: the same manifest
and recording, and the same verdict.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from tests.cached import cache
from tests.recording import RecordingError, fetch

ROOT = Path(__file__).parents[2]
JOB = "robot-state-publisher"
# Where Debian puts the node, as the stack's image has it on its PATH.
_STACK = "/usr/lib/robot_state_publisher"
# On two processors that compile something else it takes half a minute.
_SECONDS = 300


def main() -> int:
    """The exit status of `bagpipe run`: 0 when the verdict is Passed."""
    try:
        return run(f"docs/examples/{JOB}/job.yaml", cache() / "demo/laptop" / JOB)
    except RecordingError as error:
        print(f"The recording can't be had: {error}", file=sys.stderr)
    except subprocess.TimeoutExpired:
        print(f"There was no verdict within {_SECONDS} s.", file=sys.stderr)
    return 2


def run(manifest: str, results: Path, *words: str) -> int:
    """The exit status of `bagpipe run` of a manifest, which is shown as it is called.

    Raises RecordingError and subprocess.TimeoutExpired.
    """
    command = [
        f"{ROOT}/.venv/bin/bagpipe", "run", manifest, *words,
        "--agent", f"{cache()}/cargo/release/bagpipe-agent",
        "--volume", f"recordings={_recordings(cache() / 'demo/laptop')}",
        "--results", f"{results}", "--replace",
    ]  # fmt: skip
    print(f"  $ PATH={_STACK}:$PATH {' '.join(command)}", flush=True)
    environment = os.environ | {"PATH": f"{_STACK}:{os.environ['PATH']}"}
    return subprocess.run(
        command, cwd=ROOT, env=environment, timeout=_SECONDS, check=False
    ).returncode


def _recordings(folder: Path) -> Path:
    """A folder that is what the claim `recordings` is in the cluster."""
    inside = folder / "recordings" / "pr2"
    inside.mkdir(parents=True, exist_ok=True)
    shutil.copy(fetch(), inside / "joint_states.bag")
    return folder / "recordings"


if __name__ == "__main__":
    sys.exit(main())
