"""Results as files: each exactly once whatever fails, of any size, in bounded memory."""

import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import google_crc32c
import pytest
from pyspark import SparkContext
from pyspark.errors import PySparkException

import bagpipe
from bagpipe.binpiped.saving import Manifest, SavedRecord, commit
from bagpipe.storage import Storage, StorageError
from tests.integration.binpipe.conftest import EXAMPLES, python
from tests.processes import below

REPEAT = python(EXAMPLES / "repeat.py")
COPY = (
    "from bagpipe import binpipe\nfor r in binpipe.read(): binpipe.write(r.pieces(), name=r.name)"
)
# What docs/concepts/binpipedrdd.md promises of a worker, whatever the size of a record.
WORKER_BYTES = 128 << 20
LARGE = 3 << 30


def stored(folder: Path) -> list[Path]:
    return sorted(path for path in (folder / "data").glob("*/*") if path.is_file())


def test_each_record_is_one_file_and_the_manifest_says_which(
    context: SparkContext, files: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    saved = bagpipe.bin_piped(context, f"{files}/*.bin", command=REPEAT).save_as_binary_files(
        str(out)
    )
    assert saved == bagpipe.read_manifest(str(out))
    assert saved.bytes == 36_000
    assert len(stored(out)) == 9
    for record in saved.records:
        data = (out / record.file).read_bytes()
        assert data == Path(record.name.removeprefix("file://").removesuffix("#0")).read_bytes()
        assert record.crc32c == google_crc32c.value(data)
        assert record.fields == {"bytes_in": len(data)}


def test_a_folder_takes_the_results_of_one_run(
    context: SparkContext, files: Path, tmp_path: Path
) -> None:
    piped = bagpipe.bin_piped(context, f"{files}/1000.bin", command=REPEAT)
    piped.save_as_binary_files(f"{tmp_path}/out")
    with pytest.raises(StorageError, match="another run"):
        piped.save_as_binary_files(f"{tmp_path}/out")


def test_of_runs_that_commit_at_the_same_moment_one_wins(tmp_path: Path) -> None:
    runs = 8
    for number in range(20):
        uri = f"file://{tmp_path}/{number}"
        manifests = [Manifest(uri, [SavedRecord(str(n), "data/a/b", n, n)]) for n in range(runs)]
        together = threading.Barrier(runs)

        def put(manifest: Manifest, together: threading.Barrier = together) -> bool:
            together.wait(60)
            return commit(Storage({}), manifest)

        with ThreadPoolExecutor(runs) as pool:
            won = list(pool.map(put, manifests))
        assert won.count(True) == 1
        assert bagpipe.read_manifest(uri) == manifests[won.index(True)]


def test_of_two_whole_runs_into_one_folder_one_wins_and_nothing_of_the_other_is_left(
    context: SparkContext, files: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    # Each program waits for the other: both runs have begun before either can commit.
    code = (
        "import os, sys, time\nfrom bagpipe import binpipe\n"
        "own, other = sys.argv[1:]\n"
        "open(own, 'w').close()\nend = time.monotonic() + 60\n"
        "while not os.path.exists(other) and time.monotonic() < end: time.sleep(0.01)\n"
        "assert os.path.exists(other)\n"
        "for r in binpipe.read(): binpipe.write(r.read(), name=own)"
    )
    marks = [str(tmp_path / "first"), str(tmp_path / "second")]

    def run(pair: list[str]) -> Manifest | Exception:
        piped = bagpipe.bin_piped(
            context, f"{files}/1000.bin", command=python("-c", code, *pair), partitions=1
        )
        try:
            saved: Manifest = piped.save_as_binary_files(str(out))
        except StorageError as error:
            return error
        return saved

    with ThreadPoolExecutor(2) as pool:
        ended = list(pool.map(run, [marks, marks[::-1]]))
    (saved,) = (end for end in ended if isinstance(end, Manifest))
    (refused,) = (end for end in ended if isinstance(end, StorageError))
    assert "another run" in str(refused)
    assert saved == bagpipe.read_manifest(str(out))
    assert [str(p.relative_to(out)) for p in stored(out)] == [r.file for r in saved.records]


def test_a_task_that_fails_and_is_run_again_leaves_nothing_twice(
    context: SparkContext, files: Path, tmp_path: Path
) -> None:
    mark, out = tmp_path / "failed", tmp_path / "out"
    code = (
        "import os\nfrom bagpipe import binpipe\n"
        "for n, r in enumerate(binpipe.read()):\n"
        "    binpipe.write(r.read(), name=r.name)\n"
        f"    if n == 2 and not os.path.exists({str(mark)!r}):\n"
        f"        binpipe.flush(); open({str(mark)!r}, 'w').close(); os._exit(1)"
    )
    piped = bagpipe.bin_piped(context, f"{files}/*.bin", command=python("-c", code))
    saved = piped.save_as_binary_files(str(out))
    assert mark.exists()
    names = [record.name for record in saved.records]
    assert names == sorted(f"file://{path}" for path in files.glob("*.bin"))
    assert [str(p.relative_to(out)) for p in stored(out)] == sorted(r.file for r in saved.records)


def test_a_job_that_fails_has_no_manifest_and_no_files(
    context: SparkContext, files: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    code = COPY + "\nraise SystemExit(2)"
    piped = bagpipe.bin_piped(context, f"{files}/*.bin", command=python("-c", code))
    with pytest.raises(PySparkException, match="exit status 2"):
        piped.save_as_binary_files(str(out))
    assert not (out / "manifest.json").exists()
    assert stored(out) == []


def test_what_tasks_write_until_spark_cancels_them_is_removed(
    context: SparkContext, files: Path, tmp_path: Path
) -> None:
    """One task fails for good while another has whole files and a torn one, and goes on."""
    out, both = tmp_path / "out", tmp_path / "both"
    os.mkfifo(both)
    code = (
        "import signal, sys\nfrom bagpipe import binpipe\n"
        "for r in binpipe.read():\n"
        f"    if '0000.bin' in r.name: open({str(both)!r}); sys.exit(2)\n"
        "    binpipe.write(r.read(), name=r.name)\n"
        "    binpipe.flush()\n"
        f"written = open({str(both)!r}, 'w')\n"
        "signal.pause()"
    )
    piped = bagpipe.bin_piped(context, f"{files}/*.bin", command=python("-c", code))
    with pytest.raises(PySparkException, match="exit status 2"):
        piped.save_as_binary_files(str(out))
    assert (out / "data").is_dir(), "no task wrote anything: this shows nothing"
    assert stored(out) == []


def test_three_gibibytes_in_one_record_leave_the_worker_small(
    context: SparkContext, tmp_path: Path
) -> None:
    large = tmp_path / "large.bin"
    with large.open("wb") as file:
        file.truncate(LARGE)
        file.seek(LARGE - 5)
        file.write(b"tail!")
    watched = PeakMemory()
    piped = bagpipe.bin_piped(context, str(large), command=python("-c", COPY))
    with watched:
        saved = piped.save_as_binary_files(f"{tmp_path}/out")
    (record,) = saved.records
    path = tmp_path / "out" / record.file
    assert record.bytes == path.stat().st_size == LARGE
    with path.open("rb") as file:
        file.seek(LARGE - 5)
        assert file.read() == b"tail!"
    path.unlink()
    print(f"peak of a worker: {watched.peak / 2**20:.0f} MiB")
    assert 0 < watched.peak < WORKER_BYTES


class PeakMemory:
    """The most memory that any of Spark's Python workers below this process has had, in bytes."""

    def __init__(self) -> None:
        self.peak = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_error: object) -> None:
        self._ended.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._ended.wait(0.2):
            for pid in below(os.getpid()):
                try:
                    if b"pyspark.daemon" in Path(f"/proc/{pid}/cmdline").read_bytes():
                        status = Path(f"/proc/{pid}/status").read_text()
                        line = next(x for x in status.splitlines() if x.startswith("VmHWM"))
                        self.peak = max(self.peak, int(line.split()[1]) << 10)
                except (OSError, StopIteration):
                    continue
