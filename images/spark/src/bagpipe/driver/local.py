"""`python -m bagpipe.driver.local`: a job's driver on a machine without Kubernetes.

`bagpipe run` starts it beside an agent, maybe before it knows what for: so it imports all that it
needs, and then reads its words. What it does is in `this_machine`, which is not imported here: its
processes import the program's main module again.
"""

import sys

if __name__ == "__main__":
    import signal

    from bagpipe.driver import slot_server
    from bagpipe.driver.streams import awaited, own_stdout

    # Who started it may end before it has words: what the server made is removed as well.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    stdout = own_stdout()
    slot_server.start()

    from bagpipe.driver.this_machine import main

    sys.exit(main(stdout, awaited(sys.stdin.buffer)))
