"""User logic whose record `straggler` hangs in one of its two runs; the other is as quick as any.

Usage: straggling.py FOLDER first|second. A run says that it began, and its process, by a file.
"""

import hashlib
import os
import sys
import time
from pathlib import Path

from bagpipe import binpipe


def begin(folder: Path) -> str:
    """Which run of the straggler this one is; a file can be made once."""
    for run in ("first", "second", "third"):
        try:
            with (folder / run).open("x") as file:
                file.write(str(os.getpid()))
        except FileExistsError:
            continue
        return run
    raise SystemExit("the straggler was started four times")


folder, hanging = Path(sys.argv[1]), sys.argv[2]
for record in binpipe.read():
    data = record.read()
    if record.name.startswith("straggler"):
        run = begin(folder)
        while run == hanging:
            time.sleep(60)
        while run == "first" and not (folder / "second").exists():
            time.sleep(0.05)
    binpipe.write(hashlib.sha256(data).hexdigest().encode(), name="digest")
