"""uninterested_parent.py COMMAND... [-- COMMAND...]: starts one after the other, and lives on.
The kernel collects each at its end, so that none is ever a zombie."""

import itertools
import signal
import subprocess
import sys
import threading

signal.signal(signal.SIGCHLD, signal.SIG_IGN)
for is_between, words in itertools.groupby(sys.argv[1:], lambda word: word == "--"):
    if not is_between:
        subprocess.Popen(list(words)).wait()
threading.Event().wait()
