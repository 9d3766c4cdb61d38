"""The folder of a run on this machine: what may be there, and that one run at a time is in it.

What the run began with is kept in it, locked as long as the run lasts: who goes on with another
job, or in the folder of a run that goes on, would take another's verdict for this one's. So is the
log of its driver, which locks it for itself: it may commit after the run was killed.
"""

import contextlib
import errno
import fcntl
import json
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from bagpipe.cli.manifest import API_GROUP
from bagpipe.cli.running import RunError
from bagpipe.report.stored import BEGUN, FILES, FOLDERS, LOGS, MANIFEST, PUT_ONCE
from bagpipe.spec import SimulationJobSpec

# A manifest of ours says so in its first field; the whole of it may be as long as its cases.
_HEAD_BYTES = 4096
_MOST_BEGUN_BYTES = 64 << 20
_DRIVER_LOG = "driver.log"
# What was killed with a run ends within that; a driver that storage keeps waiting takes minutes.
_DRIVER_SECONDS = 10.0
_LOOK_SECONDS = 0.05
# How a lock is refused by rights, and by file systems that have none.
_NO_LOCK = frozenset({
    errno.EACCES, errno.EPERM, errno.EBADF, errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS,
})  # fmt: skip
_OTHERWISE = ", or choose another --results"
# What decides no case and no verdict of a run on this machine.
_INDIFFERENT = frozenset({
    "spark", "storage", "output", "backoffLimit", "managedBy", "suspend", "queueName",
    "startDeadline", "activeDeadline", "ttlAfterFinished", "notify",
})  # fmt: skip
_INDIFFERENT_OF_STACK = frozenset({"resources", "imagePullPolicy"})


def beginning(
    spec: SimulationJobSpec, volumes: Mapping[str, str], cases: tuple[str, ...]
) -> dict[str, Any]:
    """All that decides the cases of a run and its verdict, in sections with their names."""
    whole = spec.model_dump(mode="json", by_alias=True)
    found = {key: part for key, part in whole.items() if key not in _INDIFFERENT}
    stack = found["stack"].items()
    found["stack"] = {key: part for key, part in stack if key not in _INDIFFERENT_OF_STACK}
    claims = {claim: str(Path(folder).resolve()) for claim, folder in volumes.items()}
    return found | {"--volume": claims, "--cases": list(cases)}


@contextlib.contextmanager
def run_folder(
    folder: Path, begun: Mapping[str, Any], *, resume: bool = False, replace: bool = False
) -> Iterator[bool]:
    """The folder while a run is in it, made where there is none; whether the run had ended before.

    Raises RunError where it has what was not meant to be touched, another run is in it, or the run
    that is to be gone on with began otherwise.
    """
    if resume and replace:
        raise RunError("--resume keeps what --replace removes: write one of them")
    with contextlib.ExitStack() as stack:
        try:
            others = _others(folder)
            if others and (not _is_a_run_s(folder) or BEGUN in others):
                raise RunError(
                    f"{folder} has {others}, which no run has left there: choose another --results"
                )
            folder.mkdir(parents=True, exist_ok=True)
            file = stack.enter_context(_opened(folder, _OTHERWISE))
            _wait_for_driver(folder / _DRIVER_LOG, _OTHERWISE)
            if replace:
                _remove(folder)
            else:
                _forget(folder, _goes_on(folder, file, begun, resume))
            _keep(file, begun)
        except OSError as error:
            raise RunError(f"{folder} can't be written: {error.strerror}") from error
        yield (folder / MANIFEST).exists()


@contextlib.contextmanager
def without_run(folder: Path) -> Iterator[None]:
    """The folder while no run is in it and none begins, but where none has ever been.

    Raises RunError where a run, or its driver, writes there, and where that can't be known.
    """
    with contextlib.ExitStack() as stack:
        with _or_ended(folder), contextlib.suppress(FileNotFoundError):
            begun = os.fdopen(_there(folder / BEGUN, os.O_NOFOLLOW), "rb")
            stack.enter_context(_locked(begun, folder, ""))
        with _or_ended(folder):
            _wait_for_driver(folder / _DRIVER_LOG, "")
        yield


@contextlib.contextmanager
def _or_ended(folder: Path) -> Iterator[None]:
    """Goes on where a lock can't be had, if the run has ended: removing needs rights of the folder
    alone. Raises RunError.
    """
    try:
        yield
    except OSError as error:
        if error.errno in _NO_LOCK and os.access(folder / MANIFEST, os.F_OK):
            return
        raise RunError(
            f"{folder} can't be locked: {error.strerror}; whether a run is writing there is not"
            " known: have its owner remove it"
        ) from error


def _opened(folder: Path, otherwise: str) -> BinaryIO:
    """What a run began with, locked until it is closed. Raises RunError, and OSError."""
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
    file = os.fdopen(os.open(folder / BEGUN, flags, 0o644), "r+b")
    return _locked(file, folder, otherwise)


def _locked(begun: BinaryIO, folder: Path, otherwise: str) -> BinaryIO:
    with contextlib.ExitStack() as unless_locked:
        unless_locked.callback(begun.close)
        try:
            fcntl.flock(begun, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Who deleted the folder meanwhile had the lock, and removed the file with it.
            if not os.path.samestat(os.fstat(begun.fileno()), (folder / BEGUN).stat()):
                raise FileNotFoundError
        except (BlockingIOError, FileNotFoundError) as error:
            raise RunError(
                f"another run is writing into {folder}, or it is being deleted: wait{otherwise}"
            ) from error
        unless_locked.pop_all()
    return begun


def _there(file: Path, flags: int = 0) -> int:
    """A file that may be another user's, for a lock: NFS gives none of what is read alone."""
    flags |= os.O_NONBLOCK | os.O_CLOEXEC
    try:
        return os.open(file, flags | os.O_RDWR)
    except PermissionError:
        return os.open(file, flags | os.O_RDONLY)


def _wait_for_driver(log: Path, otherwise: str) -> None:
    """Returns when no driver of an earlier run writes to its log. Raises RunError, and OSError."""
    deadline = time.monotonic() + _DRIVER_SECONDS
    while _is_locked(log):
        if time.monotonic() >= deadline:
            raise RunError(
                f"the driver of an earlier run still writes into {log.parent}, though that run was"
                f" killed: wait until it has ended (`fuser {log}` shows its processes){otherwise}"
            )
        time.sleep(_LOOK_SECONDS)


def _is_locked(file: Path) -> bool:
    try:
        descriptor = _there(file)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


def _goes_on(folder: Path, file: BinaryIO, begun: Mapping[str, Any], resume: bool) -> bool:
    """Whether there is a run to go on with. Raises RunError where it was not to be, or can't."""
    ended = (folder / MANIFEST).exists()
    if ended and not resume:
        raise RunError(f"{folder} has a run already: write --replace, or another --results")
    journal = folder / "journal"
    interrupted = journal.is_dir() and any(journal.iterdir())
    if interrupted and not resume:
        raise RunError(
            f"{folder} has an interrupted run: --resume goes on with it (its cases are not run"
            " again, whatever has changed in the stack), --replace starts over"
        )
    if (ended or interrupted) and (differs := _differs(file, begun)):
        raise RunError(
            f"{folder} has a run that began {differs}, whose results say nothing of this one:"
            " --replace starts over, another --results keeps both"
        )
    return ended or interrupted


def _differs(file: BinaryIO, begun: Mapping[str, Any]) -> str:
    """In what a run began otherwise, in words; empty where it began as this one."""
    try:
        found = json.loads(file.read(_MOST_BEGUN_BYTES))["begun"]
    except (ValueError, TypeError, KeyError):
        return "by an earlier release, without a record of how"
    names = {*found, *begun}
    other = sorted(name for name in names if found.get(name) != begun.get(name))
    return f"with other {', '.join(other)}" if other else ""


def _forget(folder: Path, goes_on: bool) -> None:
    """Removes what does not count for the run: all without a manifest, such as the lines of one
    whose manifest is gone, but for what a run that goes on began with.
    """
    if (folder / MANIFEST).exists():
        return
    for name in FILES:
        if not goes_on or name not in PUT_ONCE:
            (folder / name).unlink(missing_ok=True)


def _keep(file: BinaryIO, begun: Mapping[str, Any]) -> None:
    file.seek(0)
    file.truncate()
    file.write(json.dumps({"schema": f"{API_GROUP}begun/v1alpha1", "begun": begun}).encode())
    file.flush()


def _is_a_run_s(folder: Path) -> bool:
    """Whether the folder has what only a run leaves: its manifest, or its logs."""
    manifest = folder / MANIFEST
    if manifest.is_file():
        with manifest.open("rb") as file:
            if f'"{API_GROUP}manifest/'.encode() in file.read(_HEAD_BYTES):
                return True
    # A run that died before its first journal has both logs.
    return (folder / _DRIVER_LOG).is_file() and any(
        (folder / name).exists() for name in ("journal", "agent.log")
    )


def _others(folder: Path) -> str:
    """Files and filled folders named as a run's are, but for logs, which are no loss."""
    found = [name for name in (MANIFEST, *FILES) if (folder / name).exists()]
    found += [n for n in FOLDERS if (folder / n).is_dir() and any((folder / n).iterdir())]
    found += [BEGUN] if _is_another_s(folder / BEGUN) else []
    return ", ".join(found)


def _is_another_s(begun: Path) -> bool:
    """Whether a file of that name is none that a run has left."""
    if not begun.is_file():
        return False
    with begun.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    return bool(head) and f'"{API_GROUP}begun/'.encode() not in head


def _remove(folder: Path) -> None:
    """Removes what a run leaves, and nothing else that may lie there.

    What shows that a run has left it goes last: who is interrupted midway may do it again.
    """
    for name in FILES:
        (folder / name).unlink(missing_ok=True)
    for name in FOLDERS:
        if (folder / name).is_dir():
            shutil.rmtree(folder / name)
    for name in (MANIFEST, *LOGS):
        (folder / name).unlink(missing_ok=True)
