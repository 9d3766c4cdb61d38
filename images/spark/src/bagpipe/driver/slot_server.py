"""The server off which slots' processes are forked, so that only one imports what cases need.

It imports nothing itself that takes time: a driver starts it first of all, and imports its own
modules meanwhile. Threads of the driver's are no danger to the slots: the server has none.
"""

import multiprocessing
import multiprocessing.forkserver
import multiprocessing.util
import os
import tempfile
from multiprocessing.context import ForkServerContext

_PRELOADED = ["bagpipe.driver.own_packages_first", "bagpipe.run.case_run"]
# A socket's path has at most 107 bytes, of which multiprocessing's own names below the folder of
# temporary files take 32.
_LONGEST_FOLDER = 107 - 32
_SHORT_FOLDER = "/tmp"  # noqa: S108  in a folder of its own there, which mkdtemp makes


def start() -> None:
    """Start it, where it does not run; what its processes write goes where this one's does now."""
    forks()
    multiprocessing.forkserver.ensure_running()


def forks() -> ForkServerContext:
    """What starts processes off it, and it before the first of them."""
    _make_room_for_sockets()
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_PRELOADED)
    return context


def _make_room_for_sockets() -> None:
    """Has multiprocessing keep its sockets where their paths fit, whatever TMPDIR is.

    Python does so itself from 3.14 on (gh-132124).
    """
    if len(os.fsencode(tempfile.gettempdir())) <= _LONGEST_FOLDER:
        return
    usual, tempfile.tempdir = tempfile.tempdir, _SHORT_FOLDER
    try:
        # It remembers the folder.
        multiprocessing.util.get_temp_dir()
    finally:
        tempfile.tempdir = usual
