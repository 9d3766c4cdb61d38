"""`python -m bagpipe.driver.local`: a job's driver on a machine without Kubernetes.

`bagpipe run` starts it beside an agent, maybe before it knows what for: so it imports all that it
needs, and then reads its words. What it does is in `this_machine`, which is not imported here: its
processes import the program's main module again.
"""

import sys

if __name__ == "__main__":
    import signal

    from bagpipe.driver import own_packages_first, slot_server  # noqa: F401
    from bagpipe.driver.streams import awaited, own_stdout

    asked: list[int] = []

    def end(number: int, _frame: object) -> None:
        asked.append(number)
        sys.exit(128 + number)

    # Who started it may end before it has words: what the server made is removed as well.
    signal.signal(signal.SIGTERM, end)
    stdout = own_stdout()
    slot_server.start()

    from bagpipe.driver.this_machine import main

    if asked:  # where an import takes a callback's exception for itself
        sys.exit(128 + asked[0])
    sys.exit(main(stdout, awaited(sys.stdin.buffer)))
