"""Prints what was said of rows: python -m tests.liars.show [NAME ...]."""

import os
import sys
import tempfile
from pathlib import Path

from tests.agent_binary import built
from tests.liars.army import Army
from tests.liars.table import ROWS


def main(names: list[str]) -> int:
    agent = Path(os.environ.get("BAGPIPE_AGENT") or built())
    cache = Path(os.environ.get("BAGPIPE_CACHE") or Path.home() / ".cache/bagpipe") / "liars"
    wanted = [row for row in ROWS if not names or row.name in names]
    with tempfile.TemporaryDirectory() as folder:
        army = Army(Path(folder), agent, cache)
        army.start(wanted)
        for row in wanted:
            try:
                told = army.told(row)
            except AssertionError as error:
                print(f"{row.name:22}|{str(error)[-300:]!r}", flush=True)
                continue
            said = f"{told.outcome} {told.reason}"
            wrong = "" if told.outcome in row.outcome.split("|") else "WRONG"
            ran = "" if all(told.marks.get(mark) for mark in row.marks) else "NOT RUN"
            print(f"{row.name:22}|{row.outcome:14}|{said:26}|{wrong}{ran}|{told.words[:250]!r}")
        army.end()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
