"""`bagpipe open` of rows that are not those of one bag and one failed course in its window."""

import json
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from mcap.reader import make_reader

import bagpipe
from bagpipe.cli import open as open_module
from bagpipe.cli.__main__ import main
from bagpipe.plan.case import Case
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from bagpipe.view import recording
from bagpipe.view.server import FileServer
from tests.mcap_of_bag import mcap_of
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.jobs import make_row, make_spec
from tests.unit.report.publishing import publish

SECOND = 1_000_000_000
TENTH = SECOND // 10
# Of a recording of ten seconds from second 1 on.
WINDOW = [2 * SECOND, 3 * SECOND, 9 * SECOND]
RECORDED = "cases/a-0000.bag"


def finding(name: str, points: list[list[float]]) -> dict[str, Any]:
    found = {"name": name, "kind": "bounds", "outcome": "failed", "message": f"why {name}"}
    course = {"label": "x", "unit": "m", "low": None, "high": 1.0, "points": points}
    return found | {"course": course}


def write_given(tmp_path: Path) -> None:
    given = steady("/scan", 100, TENTH, SECOND) + steady("/lane", 100, TENTH, SECOND)
    if not (tmp_path / "a.bag").exists():
        write_bag(tmp_path / "a.bag", sorted(given, key=lambda each: each.time), chunk_bytes=1024)


def results_with(
    tmp_path: Path, rows: Iterable[dict[str, Any]], recorded: str = RECORDED, **changed: Any
) -> Path:
    """A job's results, of which a stack published on /out for the twelve seconds from 3 on."""
    write_given(tmp_path)
    folder = publish(tmp_path, rows, **changed)
    (folder / "cases").mkdir(exist_ok=True)
    write_bag(folder / recorded, steady("/out", 120, TENTH, 3 * SECOND))
    return folder


def failed(*criteria: dict[str, Any], **changed: Any) -> dict[str, Any]:
    fields = {"recorded": RECORDED, "window": WINDOW, "criteria": list(criteria), "result": None}
    return make_row("a-0000", "failed", "CriteriaFailed", **(fields | changed))


def opened(tmp_path: Path, results: Path, *more: str, case: str = "a-0000") -> tuple[int, str, str]:
    volume = f"recordings={tmp_path}"
    where = ["--results", str(results), "--volume", volume, "--to", str(tmp_path / "shown")]
    ended = CliRunner().invoke(main, ["open", case, *where, *more])
    assert ended.exception is None or isinstance(ended.exception, SystemExit), ended.exception
    assert "unexpected fault" not in ended.stderr, ended.stderr
    return ended.exit_code, ended.stdout, ended.stderr


def shown(tmp_path: Path, case: str = "a-0000") -> list[tuple[str, int, bytes]]:
    with (tmp_path / f"shown/{case}.mcap").open("rb") as stream:
        found = make_reader(stream).iter_messages()
        return [(channel.topic, each.log_time, each.data) for _, channel, each in found]


def test_an_answer_after_the_windows_end_is_shown_with_its_moment(tmp_path: Path) -> None:
    results = results_with(tmp_path, [failed(finding("late", [[1.0, 0.2], [8.5, 1.5]]))])
    status, text, _ = opened(tmp_path, results, "--output", "json")
    assert status == 0
    found = json.loads(text)
    # The window ends at 9 s: the recorder waited for answers.
    assert (found["moment"], found["start"]) == (8.5, int(9.5 * SECOND))
    assert found["end"] == int(11.5 * SECOND) + 1
    counted = Counter(topic for topic, _, _ in shown(tmp_path))
    assert (counted["/bagpipe/log"], counted["/out"], counted["/scan"]) == (1, 21, 15)
    assert opened(tmp_path, results, "--last", "1")[0] == 0
    assert {time for topic, time, _ in shown(tmp_path) if topic == "/out"} == {
        8 * SECOND + n * TENTH for n in range(10)
    }


def test_an_answer_after_the_recordings_end_is_shown_alone(tmp_path: Path) -> None:
    results = results_with(tmp_path, [failed(finding("late", [[10.5, 1.5]]))])
    assert opened(tmp_path, results)[0] == 0
    counted = Counter(topic for topic, _, _ in shown(tmp_path))
    assert counted == {"/out": 21, "/bagpipe/log": 1, "/bagpipe/criteria/late": 1}


@pytest.mark.parametrize(
    "more", [["--at", "nan"], ["--at", "inf"], ["--last", "nan"], ["--last", "inf"]]
)
def test_a_time_that_is_no_number_is_refused(tmp_path: Path, more: list[str]) -> None:
    status, _, error = opened(tmp_path, results_with(tmp_path, [failed()]), *more)
    assert status == 2
    assert f"{more[0]} {more[1]}: write a number of seconds" in error


@pytest.mark.parametrize("last", ["0", "-1"])
def test_the_last_seconds_are_more_than_none(tmp_path: Path, last: str) -> None:
    status, _, error = opened(tmp_path, results_with(tmp_path, [failed()]), "--last", last)
    assert status == 2
    assert f"--last {last}: write how many seconds, more than 0" in error
    assert not (tmp_path / "shown").exists()


def test_what_others_wrote_is_no_command_to_the_terminal(tmp_path: Path) -> None:
    row = failed(finding("\x1b[2J", [[1.0, 5.0]]), message="\x1b]0;owned\x07")
    status, text, _ = opened(tmp_path, results_with(tmp_path, [row]))
    assert (status, "\x1b" in text, "why" in text) == (0, False, True)
    lost = row | {"window": None}
    status, _, error = opened(tmp_path, results_with(tmp_path, [lost], uid="uid-2"))
    assert (status, "\x1b" in error, "owned" in error) == (2, False, True)


@pytest.mark.parametrize("output", ["json", "yaml"])
def test_served_data_is_alone_on_stdout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, output: str
) -> None:
    def interrupted(_server: FileServer, poll_interval: float) -> None:
        raise KeyboardInterrupt(poll_interval)

    monkeypatch.setattr(FileServer, "serve_forever", interrupted)
    results = results_with(tmp_path, [failed()])
    status, text, error = opened(tmp_path, results, "--serve", "--output", output)
    assert status == 0
    assert "http" not in text
    assert "http://127.0.0.1:" in error
    assert "http://127.0.0.1:" in opened(tmp_path, results, "--serve")[1]


def _sequence(tmp_path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The row of a sequence of two pieces, and the job's source."""
    write_given(tmp_path)
    pieces = [{"bag": "pvc://recordings/a.bag", "from": f"{n}s", "to": f"{n + 1}s"} for n in (2, 6)]
    source = {"sequence": pieces}
    case: Case = plan(make_spec(source=source), Storage({"recordings": str(tmp_path)})).cases[0]
    window = [case.window.lead_in_start, case.window.start, case.window.end]
    named = {"case": case.id, "bag": case.bag, "window": window} | case.pieces
    conditions = {"seed": case.conditions.seed, "round": case.conditions.round}
    return failed() | named | conditions | {"fragment": case.fragment}, source


def test_topics_of_a_sequence_are_chosen(tmp_path: Path) -> None:
    row, source = _sequence(tmp_path)
    results = results_with(tmp_path, [row], source=source)
    case = row["case"]
    assert opened(tmp_path, results, case=case)[0] == 0
    counted = Counter(topic for topic, _, _ in shown(tmp_path, case))
    assert (counted["/scan"], counted["/lane"]) == (20, 20)
    assert opened(tmp_path, results, "--topic", "/scan", case=case)[0] == 0
    assert "/lane" not in {topic for topic, _, _ in shown(tmp_path, case)}
    status, _, error = opened(tmp_path, results, "--topic", "/none", case=case)
    assert (status, "has no topic /none; it has /lane, /scan" in error) == (2, True)


def test_a_recording_that_was_cut_is_shown_as_far_as_it_goes_and_named(tmp_path: Path) -> None:
    results = results_with(tmp_path, [failed()])
    assert opened(tmp_path, results)[2] == ""
    data = (results / RECORDED).read_bytes()
    (results / RECORDED).write_bytes(data[: len(data) - 20])
    status, _, error = opened(tmp_path, results)
    assert status == 0
    assert error.startswith(f"note: {RECORDED}: expected ")
    assert error.endswith(": what is whole is shown\n")


@pytest.mark.parametrize("changed", [{}, {"recorded": "pvc://robots/cases/a-0000.bag"}])
def test_a_claim_without_a_folder_is_asked_for(tmp_path: Path, changed: dict[str, Any]) -> None:
    results = results_with(tmp_path, [failed(**changed)])
    volume = [] if not changed else ["--volume", f"recordings={tmp_path}"]
    claim = "robots" if changed else "recordings"
    arguments = ["open", "a-0000", "--results", str(results), "--to", str(tmp_path / "shown")]
    ended = CliRunner().invoke(main, [*arguments, *volume])
    assert ended.exit_code == 2
    assert f"the claim {claim} is not on this machine: give --volume {claim}=FOLDER" in ended.stderr


@pytest.mark.parametrize("of_mcap", [False, True])
def test_what_a_small_file_unpacks_to_has_a_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, of_mcap: bool
) -> None:
    results = results_with(tmp_path, [failed()])
    file = results / RECORDED
    if of_mcap:
        mcap_of(file, tmp_path / "published", "zstd").replace(file)
    else:
        file.write_bytes(bagpipe.MemoryBag.open(file).slice(compression="lz4").to_bytes())
    assert opened(tmp_path, results)[0] == 0
    (tmp_path / "shown/a-0000.mcap").unlink()
    monkeypatch.setattr(recording, "_MOST_BYTES", 2_000)
    status, _, error = opened(tmp_path, results)
    assert (status, "a recording of a-0000: " in error) == (2, True), error
    assert not list((tmp_path / "shown").glob("*.mcap"))


def test_all_recordings_of_a_case_have_one_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = "cases/a-0000.other.bag"
    results = results_with(tmp_path, [failed(bag="simulator", recorded=[RECORDED, other])])
    size = len((results / RECORDED).read_bytes())
    (results / other).write_bytes((results / RECORDED).read_bytes())
    monkeypatch.setattr(open_module, "_BUDGET", 2 * size)
    assert opened(tmp_path, results)[0] == 0
    monkeypatch.setattr(open_module, "_BUDGET", 2 * size - 1)
    status, _, error = opened(tmp_path, results)
    assert status == 2
    assert f"{other} has {size} bytes where at most {size - 1} are expected" in error


def test_a_sequence_whose_recording_was_damaged_since_is_refused(tmp_path: Path) -> None:
    row, source = _sequence(tmp_path)
    results = results_with(tmp_path, [row], source=source)
    data = (tmp_path / "a.bag").read_bytes()
    for begin in (data.index(b"00000025"), data.index(b"00000065")):
        damaged = bytearray(data)
        damaged[begin - 60 : begin] = b"\xff" * 60
        (tmp_path / "a.bag").write_bytes(damaged)
        status, _, error = opened(tmp_path, results, case=row["case"])
        assert (status, "a.bag" in error) == (2, True), error


def test_of_a_simulated_drive_what_was_published_is_shown(tmp_path: Path) -> None:
    row = failed(bag="simulator")
    status, _, error = opened(tmp_path, results_with(tmp_path, [row]))
    assert (status, error) == (0, "")
    assert Counter(topic for topic, _, _ in shown(tmp_path)) == {"/out": 60}


def test_a_file_without_a_time_has_no_window(tmp_path: Path) -> None:
    row = failed(window=[0, 0, 0])
    status, _, error = opened(tmp_path, results_with(tmp_path, [row]))
    assert status == 2
    assert "a-0000 has no window that could be shown: it was given a file as it is" in error
    assert "pvc://recordings/a.bag" in error


@pytest.mark.parametrize("name", ["../../../a.bag", "cases/../../../a.bag", "/a.bag"])
def test_a_name_that_leaves_the_results_is_not_followed(tmp_path: Path, name: str) -> None:
    results = results_with(tmp_path, [failed(recorded=[RECORDED, name])])
    status, _, error = opened(tmp_path, results)
    assert status == 2
    assert f"{name} is no name below" in error
    assert not (tmp_path / "shown").exists()


@pytest.mark.parametrize(
    "changed",
    [
        {"window": ["a", "b", "c"]},
        {"window": [1]},
        {"window": 7},
        {"criteria": [{}]},
        {"criteria": [{"outcome": "failed", "name": "x", "message": "", "course": {"low": 1}}]},
        {"criteria": [finding("x", [[float("nan"), 2.0]])]},
        {"criteria": [finding("x", [[1e300, 2.0]])]},
        {"criteria": [finding("x", [["0", "1"]])]},  # type: ignore[list-item]
        {"criteria": 5},
        {"recorded": [None]},
        {"recorded": 5},
        {"bag": None},
    ],
)
def test_a_line_of_another_shape_is_refused(tmp_path: Path, changed: dict[str, Any]) -> None:
    row = failed() | changed
    results = results_with(tmp_path, [failed()])
    (results / "results.jsonl").write_text(json.dumps(row) + "\n")
    status, _, error = opened(tmp_path, results)
    assert status == 2
    assert "results.jsonl has a line of a-0000 that is no row of results" in error


def test_a_damaged_recording_leaves_the_file_of_before(tmp_path: Path) -> None:
    results = results_with(tmp_path, [failed()])
    assert opened(tmp_path, results)[0] == 0
    before = (tmp_path / "shown/a-0000.mcap").read_bytes()
    data = bytearray((results / RECORDED).read_bytes())
    # Within the chunk's records: the index still names what is no message any more.
    begin = data.index(b"/out") + 2000
    data[begin : begin + 400] = bytes(400)
    (results / RECORDED).write_bytes(data)
    status, _, error = opened(tmp_path, results)
    assert status == 2, error
    assert (tmp_path / "shown/a-0000.mcap").read_bytes() == before
    assert [each.name for each in (tmp_path / "shown").iterdir() if "part" in each.name] == []
