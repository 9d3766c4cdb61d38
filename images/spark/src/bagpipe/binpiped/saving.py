"""Results as files: streamed by the workers, and counted only once, by a manifest.

A task writes below a folder that only this attempt has; the driver puts the manifest, once, when
all tasks have succeeded. Of runs that share a folder one gets its manifest there. What others and
attempts that failed left behind is in no manifest, and is removed.
"""

import base64
import contextlib
import json
import re
import time
import uuid
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field

import google_crc32c
from pyspark import RDD, SparkContext

from bagpipe.binpiped.partition import PartitionRun
from bagpipe.binpiped.planning import Descriptor, located
from bagpipe.binpiped.record import Field, Fields, OutputHead
from bagpipe.storage import Storage, StorageError

MANIFEST = "manifest.json"
_DATA = "data"
_NAME_CHARACTERS = 80
# Spark kills the Python worker of a task that it cancels within 4 s; a busy machine needs longer.
_CANCEL_SECONDS, _LOOK_SECONDS = 60.0, 0.1


@dataclass(frozen=True)
class SavedRecord:
    """One file: its record's name and fields, its path below the manifest, bytes and CRC-32C."""

    name: str
    file: str
    bytes: int
    crc32c: int
    fields: Fields = field(default_factory=dict)


@dataclass(frozen=True)
class Manifest:
    """What a save stored; `uri` is the folder."""

    uri: str
    records: list[SavedRecord]

    @property
    def bytes(self) -> int:
        """Of all records together."""
        return sum(record.bytes for record in self.records)

    def location(self, record: SavedRecord) -> str:
        """A record's URI."""
        return f"{self.uri}/{record.file}"


def save(planned: RDD[Descriptor], run: PartitionRun, uri: str) -> Manifest:
    """Run, store, commit. Raises StorageError, also where another run's manifest is there."""
    uri = uri.rstrip("/")
    _refuse_second(run.storage, uri)
    own = uuid.uuid4().hex[:12]

    def store(index: int, descriptors: Iterable[Descriptor]) -> Iterable[SavedRecord]:
        return _store(run, uri, f"{own}-{index:05d}-{uuid.uuid4().hex[:12]}", descriptors)

    def ours(attempt: str) -> bool:
        return attempt.startswith(f"{own}-")

    jobs = _Jobs(planned.context)
    try:
        rows: list[SavedRecord] = planned.mapPartitionsWithIndex(store).collect()
    except Exception:
        jobs.await_tasks()
        # Raise the failure, not that files of it remain: the next commit here removes them.
        with contextlib.suppress(StorageError):
            _remove(run.storage, uri, ours)
        # A run that has committed since then removed this one's files while it wrote them.
        _refuse_second(run.storage, uri)
        raise
    manifest = Manifest(uri, sorted(rows, key=lambda row: (row.name, row.file)))
    if not commit(run.storage, manifest):
        _remove(run.storage, uri, ours)
        raise _taken(uri)
    kept = {record.file.split("/")[1] for record in manifest.records}
    _remove(run.storage, uri, lambda attempt: attempt not in kept)
    return manifest


def commit(storage: Storage, manifest: Manifest) -> bool:
    """Put a manifest into its folder; False where another run's is there. Raises StorageError.

    Of several callers at the same time exactly one gets True.
    """
    document = {
        "version": 1,
        "bytes": manifest.bytes,
        "records": [asdict(row) | {"fields": _plain(row.fields)} for row in manifest.records],
    }
    return storage.put_once(f"{manifest.uri}/{MANIFEST}", json.dumps(document, indent=1).encode())


def read_manifest(uri: str, storage: Storage | None = None) -> Manifest:
    """What an earlier save stored in a folder. Raises StorageError."""
    storage = storage or Storage({})
    uri = located(uri).rstrip("/")
    path = f"{uri}/{MANIFEST}"
    document = json.loads(storage.read(path, 0, storage.size(path)))
    rows = [row | {"fields": _typed(row["fields"])} for row in document["records"]]
    return Manifest(uri, [SavedRecord(**row) for row in rows])


class _Jobs:
    """What this thread's group of Spark jobs starts from now on.

    A job fails with its first hopeless task; the others are cancelled, and write until they are.
    """

    def __init__(self, context: SparkContext) -> None:
        self._tracker = context.statusTracker()
        # Without a group it is None, which the tracker takes for just that.
        self._group = context.getLocalProperty("spark.jobGroup.id")
        self._before = set(self._tracker.getJobIdsForGroup(self._group))

    def await_tasks(self) -> None:
        """Return when none of their tasks runs, or after a minute."""
        limit = time.monotonic() + _CANCEL_SECONDS
        while self._active() and time.monotonic() < limit:
            time.sleep(_LOOK_SECONDS)

    def _active(self) -> bool:
        jobs = set(self._tracker.getJobIdsForGroup(self._group)) - self._before
        known = filter(None, (self._tracker.getJobInfo(job) for job in jobs))
        stages = [self._tracker.getStageInfo(stage) for job in known for stage in job.stageIds]
        return any(stage and stage.numActiveTasks for stage in stages)


def _refuse_second(storage: Storage, uri: str) -> None:
    if MANIFEST in storage.names(uri):
        raise _taken(uri)


def _taken(uri: str) -> StorageError:
    return StorageError(f"{uri} holds the results of another run: choose an empty folder")


def _store(
    run: PartitionRun, uri: str, attempt: str, descriptors: Iterable[Descriptor]
) -> list[SavedRecord]:
    """All records of a partition as files; none of them stays where one can't be made."""
    rows: list[SavedRecord] = []
    stream = run.stream(descriptors)
    try:
        item = next(stream, None)
        while isinstance(item, OutputHead):
            head = item
            file_name = f"{_DATA}/{attempt}/{len(rows):06d}-{_safe(head.name)}"
            size = checksum = 0
            with run.storage.create(f"{uri}/{file_name}") as file:
                while isinstance(item := next(stream, None), bytes):
                    file.write(item)
                    size += len(item)
                    checksum = google_crc32c.extend(checksum, item)
            rows.append(SavedRecord(head.name, file_name, size, checksum, head.fields))
    except BaseException:
        for row in rows:
            run.storage.remove(f"{uri}/{row.file}")
        raise
    return rows


def _safe(name: str) -> str:
    """The last part of a record's name as every file system and object store takes it."""
    last = name.rstrip("/").rpartition("/")[2]
    return re.sub(r"[^\w.-]", "_", last, flags=re.ASCII)[-_NAME_CHARACTERS:] or "record"


def _remove(storage: Storage, uri: str, unwanted: Callable[[str], bool]) -> None:
    """Remove the files of the attempts that are not wanted."""
    for attempt in filter(unwanted, storage.names(f"{uri}/{_DATA}")):
        folder = f"{uri}/{_DATA}/{attempt}"
        for name in storage.names(folder):
            storage.remove(f"{folder}/{name}")


def _plain(fields: Fields) -> dict[str, str | int | dict[str, str]]:
    """JSON has no bytes: they become {"base64": text}."""
    return {
        key: {"base64": base64.b64encode(value).decode()} if isinstance(value, bytes) else value
        for key, value in fields.items()
    }


def _typed(plain: dict[str, str | int | dict[str, str]]) -> dict[str, Field]:
    return {
        key: base64.b64decode(value["base64"]) if isinstance(value, dict) else value
        for key, value in plain.items()
    }
