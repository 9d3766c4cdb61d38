"""BinPipedRDD on a real Spark: what comes back, what is refused, what a failure says."""

import os
import threading
from pathlib import Path

import pytest
from pyspark import SparkContext
from pyspark.errors import PySparkException
from pyspark.sql import SparkSession

import bagpipe
from bagpipe.storage import StorageError
from tests.integration.binpipe.conftest import EXAMPLES, HEAP_BYTES, python
from tests.waiting import PATIENCE, wait_until

REPEAT = python(EXAMPLES / "repeat.py")
IDENTITY = "from bagpipe import binpipe\nfor r in binpipe.read():\n "


def bag_of(folder: Path) -> dict[str, bytes]:
    return {f"file://{path}#0": path.read_bytes() for path in folder.glob("*.bin")}


def test_every_file_goes_through_the_program_and_comes_back(
    context: SparkContext, files: Path
) -> None:
    piped = bagpipe.bin_piped(context, f"{files}/*.bin", command=REPEAT)
    expected = bag_of(files)
    records = piped.records()
    assert records.getNumPartitions() == 2
    assert {r.name: r.data for r in records.collect()} == expected
    assert {r.fields["bytes_in"] for r in records.collect()} == {n * 1000 for n in range(9)}
    assert sorted(piped.data().map(len).collect()) == [n * 1000 for n in range(9)]
    assert sorted(piped.collect()) == sorted(expected.values())
    assert piped.count() == 9


def test_nothing_runs_before_an_action_and_one_partition_is_one_process(
    context: SparkContext, files: Path, tmp_path: Path
) -> None:
    log = tmp_path / "log"
    code = f"import os\nopen({str(log)!r}, 'a').write(f'{{os.getpid()}}\\n')\n{IDENTITY}pass"
    piped = bagpipe.bin_piped(context, f"{files}/*.bin", command=python("-c", code), partitions=3)
    assert not log.exists()
    assert piped.count() == 0
    assert len(set(log.read_text().split())) == 3


def test_the_frame_has_the_same_records_as_typed_columns(spark: SparkSession, files: Path) -> None:
    piped = bagpipe.bin_piped(spark.sparkContext, f"{files}/*.bin", command=REPEAT)
    frame = piped.to_df(spark)
    other = bagpipe.bin_piped(spark.sparkContext, f"{files}/1000.bin", command=REPEAT).to_df(spark)
    kinds = ["string", "bigint", None, "binary"]
    assert [kind or got for kind, (_, got) in zip(kinds, frame.dtypes, strict=True)] == [
        got for _, got in frame.dtypes
    ]
    rows = {row["name"]: bytes(row["data"]) for row in frame.collect()}
    assert rows == bag_of(files)
    # A frame made before another one stays what it was.
    assert frame.where("fields.integers['bytes_in'] > 5000").count() == 3
    assert other.count() == 1


def test_a_failure_reaches_the_driver_with_status_and_last_lines(
    context: SparkContext, files: Path
) -> None:
    code = "import sys\nprint('no model at /weights', file=sys.stderr)\nsys.exit(9)"
    piped = bagpipe.bin_piped(context, f"{files}/*.bin", command=python("-c", code))
    with pytest.raises(PySparkException) as failed:
        piped.count()
    assert "exit status 9" in str(failed.value)
    assert "no model at /weights" in str(failed.value)


def test_a_status_after_the_last_record_counts_too(context: SparkContext, files: Path) -> None:
    code = IDENTITY + "binpipe.write(b'x')\nraise SystemExit(5)"
    piped = bagpipe.bin_piped(context, f"{files}/*.bin", command=python("-c", code))
    with pytest.raises(PySparkException, match="exit status 5"):
        piped.count()


def test_a_record_that_no_heap_should_carry_is_refused_with_the_way_out(
    context: SparkContext, files: Path
) -> None:
    code = IDENTITY + "binpipe.write(bytes(3_000_000))"
    piped = bagpipe.bin_piped(
        context, f"{files}/0000.bin", command=python("-c", code), max_record_bytes=2_000_000
    )
    with pytest.raises(PySparkException, match="save_as_binary_files") as failed:
        piped.records().count()
    assert "3,000,000 bytes" in str(failed.value)


def test_collect_refuses_before_anything_is_moved_to_the_driver(
    context: SparkContext, files: Path
) -> None:
    piped = bagpipe.bin_piped(context, f"{files}/*.bin", command=REPEAT)
    with pytest.raises(bagpipe.CollectTooLargeError, match="save_as_binary_files") as refused:
        piped.collect(max_bytes=36_000)
    assert 36_000 < refused.value.actual < 40_000
    assert refused.value.limit == 36_000
    assert len(piped.collect(max_bytes=refused.value.actual)) == 9


def test_collect_refuses_a_gigabyte_and_the_driver_lives(
    context: SparkContext, files: Path
) -> None:
    code = IDENTITY + "[binpipe.write(bytes(20 << 20)) for _ in range(50)]"
    piped = bagpipe.bin_piped(context, f"{files}/0000.bin", command=python("-c", code))
    with pytest.raises(bagpipe.CollectTooLargeError) as refused:
        piped.collect()
    assert refused.value.actual > 50 * (20 << 20)
    # Below the budget, but more of one partition than this driver's heap of 512 MiB passes on.
    with pytest.raises(bagpipe.CollectTooLargeError, match="driver's JVM") as refused:
        piped.collect(max_bytes=2 << 30)
    assert refused.value.limit <= HEAP_BYTES
    assert context.parallelize([1, 2], 2).sum() == 3


def test_collect_refuses_a_record_that_the_heap_can_not_carry_and_the_driver_lives(
    context: SparkContext, files: Path
) -> None:
    code = IDENTITY + "binpipe.write(bytes(300 << 20))"
    piped = bagpipe.bin_piped(
        context,
        f"{files}/0000.bin",
        command=python("-c", code),
        max_record_bytes=400 << 20,
    )
    with pytest.raises(bagpipe.CollectTooLargeError, match="save_as_binary_files") as refused:
        piped.collect(max_bytes=1 << 30)
    assert refused.value.actual > 300 << 20
    assert refused.value.limit <= HEAP_BYTES / 16
    assert context.parallelize([1, 2], 2).sum() == 3


def test_collect_brings_what_the_heap_can_carry(context: SparkContext, files: Path) -> None:
    code = IDENTITY + "[binpipe.write(bytes(20 << 20)) for _ in range(6)]"
    piped = bagpipe.bin_piped(
        context, [f"{files}/0000.bin", f"{files}/1000.bin"], command=python("-c", code)
    )
    assert sum(map(len, piped.collect())) == 2 * 6 * (20 << 20)


def test_a_task_that_is_cancelled_leaves_no_program_behind(
    context: SparkContext, files: Path, tmp_path: Path
) -> None:
    mark = tmp_path / "pid"
    code = (
        f"import os, signal\nopen({str(mark)!r} + '.part', 'w').write(str(os.getpid()))\n"
        f"os.rename({str(mark)!r} + '.part', {str(mark)!r})\nsignal.pause()"
    )
    piped = bagpipe.bin_piped(context, f"{files}/1000.bin", command=python("-c", code))

    def run() -> None:
        with pytest.raises(Exception, match=r"cancel|CANCEL"):
            piped.count()

    asking = threading.Thread(target=run, daemon=True)
    asking.start()
    wait_until(mark.exists, PATIENCE, "the program did not begin")
    pid = int(mark.read_text())
    context.cancelAllJobs()
    wait_until(lambda: not alive(pid), PATIENCE, "the program goes on")
    asking.join(PATIENCE)
    assert not asking.is_alive()


def test_wrong_arguments_are_refused_at_once(context: SparkContext, files: Path) -> None:
    with pytest.raises(TypeError, match="list of strings"):
        bagpipe.bin_piped(context, f"{files}/*.bin", command="cat")
    with pytest.raises(ValueError, match="name the user logic once"):
        bagpipe.bin_piped(context, f"{files}/*.bin")
    with pytest.raises(StorageError, match="names no file"):
        bagpipe.bin_piped(context, f"{files}/*.jpg", command=REPEAT)


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    return state != "Z"
