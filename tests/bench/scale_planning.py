"""What the plan of a great job takes: its files are listed and asked for, one after the other."""

import tempfile
import time
from pathlib import Path

from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage


def planned(count: int, rounds: int) -> list[float]:
    """Cases planned in a second, of so many files in one folder; one figure for each round."""
    with tempfile.TemporaryDirectory(prefix="bagpipe-scale-") as name:
        folder = Path(name)
        for number in range(count):
            # Without a byte, as a plan reads none and each would take a block of the disk.
            (folder / f"{number:06d}").touch()
        return [_round(folder, count) for _ in range(rounds)]


def _round(folder: Path, count: int) -> float:
    spec = SimulationJobSpec.model_validate(
        {
            "source": {"files": [f"file://{folder}/*"]},
            "stack": {"engine": "exec", "image": "-", "command": ["true"]},
            "output": {"uri": f"file://{folder}/results"},
        }
    )
    begun = time.monotonic()
    made = plan(spec, Storage({}))
    seconds = time.monotonic() - begun
    if len(made.cases) != count:
        raise RuntimeError(f"{len(made.cases)} cases of {count} files: {made.unplanned[:1]}")
    return count / seconds
