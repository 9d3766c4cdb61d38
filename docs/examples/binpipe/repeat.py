"""User logic with 0, 1 or many outputs for an input: as many copies as its field `copies` says.

Every SDK has this program, and all of them pass the same tests. With `stream` the copies go
out without a size; with `exit` or `signal` the program ends before its time.
"""

import os
import sys

from bagpipe import binpipe

for record in binpipe.read():
    # It reaches stderr: an SDK keeps stdout for the frames.
    print(f"got {record.name}")
    if "exit" in record.fields:
        print("leaving early", file=sys.stderr, flush=True)
        os._exit(int(record.fields["exit"]))
    if "signal" in record.fields:
        os.kill(os.getpid(), int(record.fields["signal"]))
    data = record.read()
    for copy in range(int(record.fields.get("copies", 1))):
        fields = {key: value for key, value in record.fields.items() if key != "copies"}
        body = iter([data]) if "stream" in fields else data
        binpipe.write(body, name=f"{record.name}#{copy}", bytes_in=len(data), **fields)
