"""The folder of `bagpipe run`: whose it is, what is kept in it, and one run at a time."""

import contextlib
import errno
import fcntl
import os
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bagpipe.cli import run_folder as folders
from bagpipe.cli.run_folder import beginning, run_folder, without_run
from bagpipe.cli.running import RunError
from bagpipe.driver.same_recordings import of_the_same_recordings
from bagpipe.plan.made import Plan
from bagpipe.storage import Storage
from tests.unit.bagpipe.jobs import make_row, make_spec
from tests.unit.bagpipe.test_same_recordings import case
from tests.unit.report.publishing import publish
from tests.waiting import PATIENCE

LAX = [{"name": "delay", "latency": {"topic": "/out", "max": "10s"}}]
STRICT = [{"name": "delay", "latency": {"topic": "/out", "max": "1ms"}}]


def begun(*cases: str, volumes: dict[str, str] | None = None, **changed: Any) -> dict[str, Any]:
    return beginning(make_spec(**changed), volumes or {}, cases)


def prepare(
    folder: Path,
    how: dict[str, Any] | None = None,
    /,
    *,
    resume: bool = False,
    replace: bool = False,
) -> bool:
    """What a run that ends at once does; whether the folder's run had ended before."""
    wanted = begun() if how is None else how
    with run_folder(folder, wanted, resume=resume, replace=replace) as has_ended:
        return has_ended


def test_an_earlier_run_is_never_overwritten_unasked(tmp_path: Path) -> None:
    folder = publish(tmp_path, [make_row("a-0")])
    with pytest.raises(RunError, match="without a record of how"):
        prepare(folder, resume=True)
    prepare(folder, replace=True)
    folder = publish(tmp_path, [make_row("a-0")])
    (folder / "notes.txt").write_text("mine")
    (folder / "cases").mkdir()
    (folder / "cases/a-0.1.bag").touch()
    with pytest.raises(RunError, match="has a run already: write --replace"):
        prepare(folder)
    prepare(folder, resume=True)
    assert (folder / "manifest.json").exists()
    assert (folder / "results.jsonl").exists()
    prepare(folder, replace=True)
    # Of what lies there only what a run makes is removed.
    assert sorted(path.name for path in folder.iterdir()) == ["notes.txt", "run.json"]


@pytest.mark.parametrize("options", [{}, {"replace": True}, {"resume": True}])
@pytest.mark.parametrize(
    "name", ["cases/night/mine.bag", "job.json", "manifest.json", "journal/mine.txt"]
)
def test_what_no_run_has_left_is_neither_removed_nor_written_over(
    tmp_path: Path, name: str, options: dict[str, bool]
) -> None:
    mine = tmp_path / name
    mine.parent.mkdir(parents=True, exist_ok=True)
    mine.write_text('{"name": "mine"}')
    # One log alone may be of anything.
    (tmp_path / "agent.log").write_text("mine too")
    with pytest.raises(RunError, match=f"has {Path(name).parts[0]}, which no run has left"):
        prepare(tmp_path, **options)
    assert mine.read_text() == '{"name": "mine"}'


def test_a_run_that_died_before_its_first_journal_is_replaced(tmp_path: Path) -> None:
    for name in ("agent.log", "driver.log", "cases/a-0.1.bag"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    prepare(tmp_path)
    assert (tmp_path / "cases/a-0.1.bag").exists()
    prepare(tmp_path, replace=True)
    assert [path.name for path in tmp_path.iterdir()] == ["run.json"]


def test_there_need_be_no_run_to_replace(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    prepare(tmp_path, replace=True)
    prepare(tmp_path / "new", replace=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "new", "notes.txt", "run.json",
    ]  # fmt: skip


def test_an_interrupted_run_is_resumed_or_replaced(tmp_path: Path) -> None:
    (tmp_path / "driver.log").touch()
    (tmp_path / "journal").mkdir()
    prepare(tmp_path)
    (tmp_path / "journal/0001-x-000000.jsonl").touch()
    with pytest.raises(RunError, match="has an interrupted run: --resume goes on with it"):
        prepare(tmp_path)
    prepare(tmp_path, resume=True)
    assert (tmp_path / "journal/0001-x-000000.jsonl").exists()
    prepare(tmp_path, replace=True)
    assert not (tmp_path / "journal").exists()


def test_a_folder_that_can_t_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RunError, match=r"file/kept can't be written: Not a directory"):
        prepare(tmp_path / "file/kept")


def test_one_run_at_a_time_is_in_a_folder(tmp_path: Path) -> None:
    """`--variant released` and `--variant pr-812` in two terminals have the same folder."""
    with run_folder(tmp_path, begun()):
        for name in ("driver.log", "agent.log", "cases/a-0.bag"):
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).touch()
        runs: list[dict[str, bool]] = [{}, {"replace": True}, {"resume": True}]
        for options in runs:
            with pytest.raises(RunError, match="another run is writing into"):
                prepare(tmp_path, **options)
        assert (tmp_path / "cases/a-0.bag").exists()
    prepare(tmp_path, replace=True)
    assert not (tmp_path / "cases/a-0.bag").exists()


def test_a_lock_that_was_removed_while_it_was_taken_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`bagpipe delete` ended between the two; a second run would get the folder, too."""
    flock = fcntl.flock

    def late(file: Any, how: int) -> None:
        (tmp_path / "run.json").unlink(missing_ok=True)
        flock(file, how)

    monkeypatch.setattr("fcntl.flock", late)
    with pytest.raises(RunError, match="or it is being deleted"):
        prepare(tmp_path)


NOBODY = 65534
COLLEAGUE = textwrap.dedent(f"""
    import os, sys
    from pathlib import Path
    from bagpipe.cli.run_folder import RunError, without_run
    if not os.geteuid():
        os.setgid({NOBODY})
        os.setuid({NOBODY})
    try:
        with without_run(Path(sys.argv[1])):
            print("taken")
    except RunError as error:
        print(error)
""")


@pytest.fixture
def shared() -> Iterator[Path]:
    """A folder that all may write, as pytest's own are not."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o777)
        yield Path(name)


@pytest.mark.parametrize(
    ("mode", "ended", "answer"),
    [
        (0o444, False, "taken"),
        (0o444, True, "taken"),
        (0o000, True, "taken"),
        (0o000, False, "can't be locked: Permission denied; whether a run is writing there"),
    ],
)
def test_a_colleague_deletes_results_in_a_folder_that_both_may_write(
    shared: Path, mode: int, ended: bool, answer: str
) -> None:
    for name in ("run.json", "driver.log", *(["manifest.json"] if ended else [])):
        (shared / name).write_text("{}")
        (shared / name).chmod(mode)
    command = [sys.executable, "-c", COLLEAGUE, str(shared)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert answer in done.stdout
    if mode:
        with locked(shared):
            done = subprocess.run(command, capture_output=True, text=True, check=True)
        assert "another run is writing into" in done.stdout


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    with (folder / "run.json").open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def test_where_a_file_system_has_no_locks_results_of_a_run_that_ended_are_deleted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def flock(_file: object, _how: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    for name in ("run.json", "driver.log"):
        (tmp_path / name).touch()
    monkeypatch.setattr("fcntl.flock", flock)
    with (
        pytest.raises(RunError, match="can't be locked: No locks available"),
        without_run(tmp_path),
    ):
        pass
    (tmp_path / "manifest.json").touch()
    with without_run(tmp_path):
        pass


def interrupted(folder: Path, how: dict[str, Any]) -> None:
    prepare(folder, how)
    (folder / "driver.log").touch()
    (folder / "journal").mkdir()
    (folder / "journal/0001-x-000000.jsonl").touch()


@pytest.mark.parametrize(
    ("how", "differs"),
    [
        (begun(evaluate=STRICT), "with other evaluate,"),
        (begun(evaluate=LAX, stack={"image": "i", "command": ["y"]}), "with other stack,"),
        (begun("3", evaluate=LAX), "with other --cases,"),
        (begun(evaluate=LAX, volumes={"recordings": "/b"}), "with other --volume,"),
        (begun(evaluate=LAX, maxFailedCases=3), "with other maxFailedCases,"),
        (begun(evaluate=LAX, faultPolicy=[{"cause": "StackCrashed", "action": "allow"}]),
         "with other faultPolicy,"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("ended", [False, True])
def test_what_was_judged_otherwise_is_not_gone_on_with(
    tmp_path: Path, how: dict[str, Any], differs: str, ended: bool
) -> None:
    """Its rows would count for criteria, recordings and a stack that they have never met."""
    folder = tmp_path / "kept"
    interrupted(folder, begun(evaluate=LAX))
    if ended:
        publish(tmp_path, [make_row("a-0")]).rename(tmp_path / "published")
        (tmp_path / "published/manifest.json").rename(folder / "manifest.json")
    with pytest.raises(RunError, match=differs):
        prepare(folder, how, resume=True)
    assert prepare(folder, begun(evaluate=LAX), resume=True) is ended
    prepare(folder, how, replace=True)


def test_all_that_decides_cases_or_verdicts_is_compared() -> None:
    """A field that comes has to be put here, or among what decides nothing."""
    assert set(begun()) == {
        "source", "stack", "variants", "matrix", "playback", "record", "baseline", "comparison",
        "evaluate", "maxFailedCases", "faultPolicy", "quarantine", "resumeFrom",
        "--volume", "--cases",
    }  # fmt: skip
    assert set(begun()["stack"]) == {
        "image", "command", "engine", "env", "envFrom", "parameters", "remap", "ros1", "ros2",
        "volumeMounts", "securityContext",
    }  # fmt: skip


def test_one_folder_by_two_names_is_the_same_volume(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert begun(volumes={"r": "."}) == begun(volumes={"r": str(tmp_path)})


def test_what_a_run_began_with_takes_the_place_of_a_longer_one(tmp_path: Path) -> None:
    interrupted(tmp_path, begun(evaluate=LAX))
    prepare(tmp_path, begun(), replace=True)
    interrupted(tmp_path, begun())
    prepare(tmp_path, begun(), resume=True)


def test_what_a_run_began_with_is_not_written_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "results").mkdir()
    (tmp_path / "results/run.json").symlink_to(tmp_path / "mine")
    with pytest.raises(RunError, match="can't be written"):
        prepare(tmp_path / "results")
    assert not (tmp_path / "mine").exists()


def test_more_slots_and_memory_are_the_same_run(tmp_path: Path) -> None:
    interrupted(tmp_path, begun())
    more = {"resources": {"limits": {"memory": "4Gi"}}}
    stack = begun()["stack"] | more
    prepare(tmp_path, begun(spark={"slots": 2}, stack=stack, notify=["team"]), resume=True)


def test_a_run_of_an_earlier_release_is_not_gone_on_with(tmp_path: Path) -> None:
    """Nothing says how it began."""
    interrupted(tmp_path, begun())
    (tmp_path / "run.json").unlink()
    with pytest.raises(RunError, match="without a record of how"):
        prepare(tmp_path, resume=True)


def test_a_run_that_was_ended_early_does_not_choose_the_recordings_of_the_next(
    tmp_path: Path,
) -> None:
    """`bagpipe run --cases a`, Ctrl-C before a case ended, then `bagpipe run` of all of them."""
    folder = tmp_path / "kept"
    storage, uri = Storage({}), f"file://{folder}"
    with run_folder(folder, begun("a")):
        (folder / "driver.log").touch()
        (folder / "agent.log").touch()
        of_the_same_recordings(storage, uri, Plan([case("a")], []), list)
    with run_folder(folder, begun()):  # no journal: neither --resume nor --replace is asked for
        both = of_the_same_recordings(storage, uri, Plan([case("a"), case("b")], []), list)
    assert [each.id for each in both.cases] == ["a", "b"]


def test_nor_does_it_call_errored_what_the_mended_job_does_not_name(tmp_path: Path) -> None:
    """The pattern was too wide: Ctrl-C, a narrower one is written, and it is run again."""
    folder = tmp_path / "kept"
    storage, uri = Storage({}), f"file://{folder}"
    with run_folder(folder, begun()):
        (folder / "driver.log").touch()
        (folder / "agent.log").touch()
        of_the_same_recordings(storage, uri, Plan([case("a"), case("old")], []), list)
    with run_folder(folder, begun(source={"bags": ["pvc://recordings/a.bag"], "topics": ["/s"]})):
        found = of_the_same_recordings(storage, uri, Plan([case("a")], []), list)
    assert found.unplanned == []


@pytest.mark.parametrize("options", [{}, {"replace": True}, {"resume": True}])
@pytest.mark.parametrize("beside", [[], ["driver.log", "agent.log"]])
def test_a_file_of_mine_called_run_json_is_not_written_over(
    tmp_path: Path, options: dict[str, bool], beside: list[str]
) -> None:
    mine = tmp_path / "run.json"
    mine.write_text('{"name": "mine"}')
    for name in beside:
        (tmp_path / name).touch()
    with pytest.raises(RunError, match=r"run\.json, which no run has left"):
        prepare(tmp_path, **options)
    assert mine.read_text() == '{"name": "mine"}'


def test_a_replace_that_was_ended_midway_can_be_done_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C while gigabytes of recordings are removed."""
    folder = publish(tmp_path, [make_row("a-0")])
    (folder / "cases").mkdir()
    (folder / "cases/a-0.1.bag").touch()

    def interrupted(_path: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr("shutil.rmtree", interrupted)
        prepare(folder, replace=True)
    prepare(folder, replace=True)
    assert [path.name for path in folder.iterdir()] == ["run.json"]


@pytest.mark.parametrize("resume", [True, False])
def test_lines_of_an_earlier_run_are_not_those_of_the_next(tmp_path: Path, resume: bool) -> None:
    """Its manifest was removed by hand; a driver keeps lines that it finds."""
    interrupted(tmp_path, begun())
    for name in ("results.jsonl", "report.html", "recordings.json.gz"):
        (tmp_path / name).touch()
    if not resume:
        (tmp_path / "journal/0001-x-000000.jsonl").unlink()
    prepare(tmp_path, resume=resume)
    left = ["driver.log", "journal", *["recordings.json.gz"] * resume, "run.json"]
    assert sorted(path.name for path in tmp_path.iterdir()) == left


# A run whose driver is past its keeper: SIGTERM changes nothing until it has committed.
HOLDER = textwrap.dedent("""
    import json, sys
    from pathlib import Path
    from bagpipe.cli import driver_process
    from bagpipe.cli.run_folder import run_folder
    from bagpipe.driver.results import MANIFEST_SCHEMA
    folder = Path(sys.argv[1])
    manifest = json.dumps({"schema": MANIFEST_SCHEMA})
    program = ("import signal, sys, time, pathlib\\n"
               "from bagpipe.driver.streams import awaited, own_stdout\\n"
               "signal.signal(signal.SIGTERM, lambda *_: None)\\n"
               "out = own_stdout()\\n"
               "folder = pathlib.Path(*awaited(sys.stdin.buffer))\\n"
               "print('commits', file=out, flush=True)\\n"
               "while not (folder / 'go').exists():\\n"
               "    time.sleep(0.05)\\n"
               "part = folder / 'manifest.part'\\n"
               f"part.write_text({manifest!r})\\n"
               "part.rename(folder / 'manifest.json')\\n")
    driver_process._PROGRAM = [sys.executable, "-c", program]
    with run_folder(folder, {}):
        with driver_process.driver([str(folder)], folder / "driver.log", 60) as process:
            process.stdout.readline()
            print(process.pid, flush=True)
            sys.stdin.read()
""")


def test_a_driver_that_outlives_its_run_keeps_others_out_of_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kernel has killed `bagpipe run` for want of memory."""
    folder = tmp_path / "results"
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout is not None
        driver = int(holder.stdout.readline())
        holder.kill()
    try:
        with monkeypatch.context() as patch:
            patch.setattr(folders, "_DRIVER_SECONDS", 0.2)
            with pytest.raises(RunError, match="the driver of an earlier run still writes into"):
                prepare(folder, replace=True)
        os.kill(driver, 0)  # it is there, and commits
    finally:
        (folder / "go").touch()
    monkeypatch.setattr(folders, "_DRIVER_SECONDS", PATIENCE)
    prepare(folder, replace=True)
    assert sorted(path.name for path in folder.iterdir()) == ["go", "run.json"]
