"""Run the same tests again and again without starting Python again.

    python tests/mutation/warm.py SOCKET TEST...    serves, from a project's folder
    python -I -S tests/mutation/warm.py SOCKET      asks for one run: exits as pytest does

Each run is a fork of a process that has imported everything but the project itself, whose files
may have changed since: a run takes a third of a second, and not three.
"""

import os
import socket
import sys
import time
from pathlib import Path

# One that hangs is as good as one that fails: it takes far longer than the first run.
FIRST_SECONDS = 600.0
TIMES_LONGER, SECONDS_MORE = 5.0, 10.0
_TICK_SECONDS = 0.02


def main() -> int:
    address, *tests = sys.argv[1:]
    return serve(address, tests) if tests else ask(address)


def ask(address: str) -> int:
    """What pytest exits with, now that a file may have changed."""
    with socket.socket(socket.AF_UNIX) as asking:
        asking.connect(address)
        return int(asking.recv(16) or b"70")  # a server that died has judged nothing


def serve(address: str, tests: list[str]) -> int:
    """Answer until killed; not 0 where the tests fail before anything is broken."""
    begun = time.monotonic()
    list_of_modules = Path("modules")
    if status := _run(tests, list_of_modules, FIRST_SECONDS):
        return status
    longest = TIMES_LONGER * (time.monotonic() - begun) + SECONDS_MORE
    _import(list_of_modules.read_text().split())
    # Bytecode names the second of its source: a file that changes within the same one would be
    # taken for what it was, by what the first run has written or by what another would write.
    time.sleep(until_another_second(time.time()))
    sys.dont_write_bytecode = True
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    with socket.socket(socket.AF_UNIX) as serving:
        serving.bind(address)
        serving.listen()
        while True:
            asking, _ = serving.accept()
            with asking:
                asking.sendall(str(_run(tests, Path(os.devnull), longest)).encode())


def until_another_second(now: float) -> float:
    """Seconds until files are of another second than `now`; a file's time may be a tick late."""
    return 1.0 - now % 1.0 + _TICK_SECONDS


def foreign(modules: dict[str, object], project: Path) -> list[str]:
    """The names of the modules that are not a project's own, and that have a file."""
    found = []
    for name, module in modules.items():
        file = getattr(module, "__file__", None)
        if file and name != "__main__" and not Path(file).is_relative_to(project):
            found.append(name)
    return found


def _import(names: list[str]) -> None:
    import importlib  # noqa: PLC0415  (and others below: who asks is to start at once)

    for name in names:
        try:
            importlib.import_module(name)
        except Exception as fault:  # noqa: BLE001  (one that can't be had beforehand is imported by each run)
            print(f"not kept: {name}: {fault}", file=sys.stderr)


def _run(tests: list[str], list_of_modules: Path, longest: float) -> int:
    import contextlib  # noqa: PLC0415
    import multiprocessing  # noqa: PLC0415

    run = multiprocessing.get_context("fork").Process(target=_pytest, args=(tests, list_of_modules))
    run.start()
    run.join(longest)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(run.pid or 0, 9)  # what the tests left running, too
    run.join()
    return 70 if run.exitcode is None or run.exitcode < 0 else run.exitcode


def _pytest(tests: list[str], list_of_modules: Path) -> None:
    os.setsid()
    import pytest  # noqa: PLC0415

    status = pytest.main(["-q", "-x", "--no-header", "-p", "no:cacheprovider", *tests])
    list_of_modules.write_text("\n".join(foreign(dict(sys.modules), Path.cwd())))
    sys.stdout.flush()
    os._exit(status)


if __name__ == "__main__":
    sys.exit(main())
