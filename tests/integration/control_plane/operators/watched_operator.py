"""The operator, whose audit events show when its event loop's thread blocks.

Run in the place of `bagpipe-operator`. Files, processes, names and connections of the thread that
runs the loop are logged as `BLOCKS <event>` with the place that asked for them. Allowed is what
happens once, before there is work: imports, certificates, and reading the kubeconfig.
"""

import asyncio
import sys
import threading
import time
import traceback
from typing import SupportsIndex

from bagpipe_operator.main import main

EVENTS = {
    "open",
    "os.listdir",
    "os.scandir",
    "os.system",
    "socket.connect",
    "socket.getaddrinfo",
    "socket.gethostbyname",
    "subprocess.Popen",
}
AT_START = {"load_kube_config", "login_with_kubeconfig", "_load_unlocked", "create_default_context"}
LOOP_THREAD = threading.get_ident()
_sleep = time.sleep


def blocks(event: str, arguments: tuple[object, ...]) -> bool:
    """Whether an event makes the loop wait; connecting does not on a non-blocking socket."""
    if event not in EVENTS or threading.get_ident() != LOOP_THREAD:
        return False
    if asyncio._get_running_loop() is None:
        return False
    connecting = event == "socket.connect"
    return not connecting or getattr(arguments[0], "gettimeout", lambda: None)() != 0


def report(event: str, arguments: tuple[object, ...]) -> None:
    """The audit hook. It opens nothing itself: its descriptor is there already."""
    if not blocks(event, arguments):
        return
    callers = [
        f"{code.co_name} {code.co_filename}:{line}"
        for code, line in ((f.f_code, n) for f, n in traceback.walk_stack(sys._getframe(1)))
    ]
    if not AT_START.intersection(caller.split()[0] for caller in callers):
        sys.stderr.write(f"BLOCKS {event} {arguments[:2]} in {' < '.join(callers[:6])}\n")


def sleep(seconds: SupportsIndex | float) -> None:
    """time.sleep, which has no audit event in this Python."""
    if asyncio._get_running_loop() is not None and threading.get_ident() == LOOP_THREAD:
        sys.stderr.write(f"BLOCKS time.sleep {seconds}\n")
    _sleep(seconds)


if __name__ == "__main__":
    time.sleep = sleep
    sys.addaudithook(report)
    main()
