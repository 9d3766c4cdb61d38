"""Prints the results of rows: python -m tests.liars.show [NAME ...]."""

import os
import sys
import tempfile
from pathlib import Path

from tests.agent_binary import built
from tests.cached import cache
from tests.liars.army import Army
from tests.liars.table import ROWS


def main(names: list[str]) -> int:
    agent = Path(os.environ.get("BAGPIPE_AGENT") or built())
    wanted = [row for row in ROWS if not names or row.name in names]
    with tempfile.TemporaryDirectory() as folder:
        army = Army(Path(folder), agent, cache() / "liars")
        army.start(wanted)
        for row in wanted:
            try:
                result = army.result_of(row)
            except AssertionError as error:
                print(f"{row.name:22}|{str(error)[-300:]!r}", flush=True)
                continue
            found = f"{result.outcome} {result.reason}"
            wrong = "" if result.outcome in row.outcome.split("|") else "WRONG"
            ran = "" if all(result.marks.get(mark) for mark in row.marks) else "NOT RUN"
            print(f"{row.name:22}|{row.outcome:14}|{found:26}|{wrong}{ran}|{result.words[:250]!r}")
        army.end()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
