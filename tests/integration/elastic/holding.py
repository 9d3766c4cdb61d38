"""User logic whose record `long` ends once it is let go; the others are done at once.

Usage: holding.py FOLDER. Each run of `long` says by a file that it began.
"""

import hashlib
import sys
import time
from pathlib import Path

from bagpipe import binpipe

folder = Path(sys.argv[1])
for record in binpipe.read():
    data = record.read()
    if record.name.startswith("long"):
        (folder / f"begun-{len(list(folder.glob('begun-*'))) + 1}").touch()
        while not (folder / "go").exists():
            time.sleep(0.05)
    binpipe.write(hashlib.sha256(data).hexdigest().encode(), name="digest")
