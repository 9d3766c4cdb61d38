"""Writes the scenarios of a barrier car: where it starts, how fast it is, what it does next.

    python3 scenarios.py FOLDER

Of the 72 combinations those are left out in which the cars only part: 54 files stay.
"""

import itertools
import json
import sys
from pathlib import Path

STARTS = [
    "front", "front-right", "right", "rear-right", "rear", "rear-left", "left", "front-left",
]  # fmt: skip
SPEEDS = ["slower", "equal", "faster"]
MOTIONS = ["straight", "left", "right"]


def main() -> None:
    """One file for each scenario that is wanted."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for start, speed, motion in itertools.product(STARTS, SPEEDS, MOTIONS):
        if (start[:4], speed) in {("fron", "faster"), ("rear", "slower")}:
            continue
        barrier = {"start": start, "speed": speed, "motion": motion}
        scenario = {"speed": 25.0, "seconds": 10.0, "barrier": barrier}
        path = folder / f"{start}-{speed}-{motion}.json"
        path.write_text(json.dumps(scenario, indent=1) + "\n")


if __name__ == "__main__":
    main()
