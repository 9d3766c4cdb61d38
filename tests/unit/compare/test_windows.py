"""Pairs that are not the same part of a recording, or not of the same file."""

from typing import Any

from bagpipe.compare.compare import Comparison, compare
from bagpipe.compare.gate import objections
from tests.unit.compare.rows import row

SECOND = 1_000_000_000
RECORDINGS = 8


def rows(
    length: int, outcome: str = "passed", file: str = "v1", **more: Any
) -> list[dict[str, Any]]:
    """A fragment of each recording, of so many seconds, whose latency grows by 1 ms each second."""
    return [
        row(
            n, "", outcome, figure=0.001 * length, bag=f"file:///d{n}.bag", bag_version=file,
            window=[0, SECOND, (1 + length) * SECOND], **more,
        )
        for n in range(RECORDINGS)
    ]  # fmt: skip


def compared(now: list[dict[str, Any]], then: list[dict[str, Any]]) -> Comparison:
    [found] = compare(now, [], then)
    return found


def test_another_fragment_length_makes_nothing_better_or_worse() -> None:
    for now, then in ((20, 60), (60, 20)):
        found = compared(rows(now), rows(then))
        assert found.verdict == "unknown"
        assert found.counts["unknown"] == RECORDINGS
        assert found.message == (
            "no case of both could be compared; 8 of another part of the recording than there"
        )
        assert [one.pairs for one in found.criteria] == [0] * len(found.criteria)


def test_a_case_that_fails_in_another_window_has_not_regressed() -> None:
    found = compared(rows(60, "failed"), rows(20))
    assert (found.counts["regressed"], found.counts["unknown"]) == (0, RECORDINGS)


def test_cases_of_another_window_that_do_not_pass_now_leave_it_open() -> None:
    """Whatever else is alike: nobody has seen whether they would have passed there."""
    now = [*rows(60, "failed")[:-1], rows(20)[-1]]
    found = compared(now, rows(20))
    assert found.verdict == "unknown"
    assert (
        "; 7 of another part of the recording than there (7 pass less often now)" in found.message
    )
    [objection] = objections(found.as_json())
    assert objection.cause == "Unknown"
    assert "7 pass less often now and were not compared" in objection.message
    passing = compared([*rows(60)[:-1], rows(20)[-1]], rows(20))
    assert passing.verdict == "same"
    assert objections(passing.as_json()) == []


def test_what_is_allowed_hides_no_case_that_is_open() -> None:
    now = [*rows(60, "failed")[:-2], rows(20, "failed")[-2], rows(20)[-1]]
    found = compared(now, rows(20))
    assert (found.verdict, found.counts["regressed"], found.doubtful) == ("worse", 1, 6)
    assert [one.cause for one in objections(found.as_json())] == ["Regressed", "Unknown"]
    [objection] = objections(found.as_json(), {"Regressed"})
    assert objection.cause == "Unknown"


def test_a_case_that_flaked_before_and_never_passes_in_another_window_is_open() -> None:
    then = [each for n in range(10) for each in rows(20, "passed" if n else "failed", round=n)]
    now = [
        {**each, "round": n}
        for n in range(10)
        for each in [*rows(60, "failed")[:-1], rows(20, "passed" if n else "failed")[-1]]
    ]
    found = compared(now, then)
    assert (found.verdict, found.doubtful) == ("unknown", RECORDINGS - 1)


def test_a_case_that_flaked_before_and_flakes_in_another_window_is_not_open() -> None:
    """6 passed rounds of ten where 7 did is what chance gives: of one window it is `flaky`."""
    passes = [n < 7 for n in range(10)]
    then = [
        {**each, "round": n}
        for n in range(10)
        for each in rows(20, "passed" if passes[n] else "failed")
    ]
    now = [
        {**each, "round": n}
        for n in range(10)
        for each in [
            *rows(60, "passed" if n < 6 else "failed")[:-1],
            rows(20, "passed" if passes[n] else "failed")[-1],
        ]
    ]
    found = compared(now, then)
    assert (found.verdict, found.doubtful) == ("same", 0)
    assert objections(found.as_json()) == []


def test_cases_that_all_pass_a_little_less_often_in_another_window_are_open_together() -> None:
    """Three of three rounds and one of three are luck in one case, and not in seven."""
    then = [{**each, "round": n} for n in range(3) for each in rows(20)]
    now = [
        {**each, "round": n}
        for n in range(3)
        for each in [*rows(60, "failed" if n else "passed")[:-1], rows(20)[-1]]
    ]
    found = compared(now, then)
    assert (found.verdict, found.doubtful) == ("unknown", RECORDINGS - 1)


def test_the_lead_in_is_no_part_of_what_is_judged() -> None:
    led_in = [{**each, "window": [500, *each["window"][1:]]} for each in rows(20)]
    assert compared(rows(20), led_in).verdict == "same"


def test_rows_of_a_release_before_have_no_window() -> None:
    earlier = [{**each, "window": None, "bag_version": None} for each in rows(20)]
    found = compared(rows(60), earlier)
    assert found.verdict == "worse"
    assert "another part" not in found.message


def test_a_file_that_has_changed_since_is_named() -> None:
    found = compared(rows(20, file="v2"), rows(20))
    assert found.verdict == "same"
    assert found.message.endswith("; 8 played from a file that has changed since")
    assert "file" not in compared(rows(20), rows(20)).message


def of_folder(n: int, version: str, figure: float) -> dict[str, Any]:
    """A fragment of one folder of rosbag2, whose files are split as the fragments are."""
    file = {"bag": f"file:///d/d_{n}.mcap", "version": version, "window": [0, 1], "at": 0}
    given: dict[str, Any] = {"bag": "file:///d/metadata.yaml", "bag_version": "v1", "parts": [file]}
    return row(n, "", figure=figure, **given)


def test_a_folder_is_one_recording_however_many_files_it_is_split_into() -> None:
    then = [of_folder(n, "v1", 0.050) for n in range(8)]
    found = compared([of_folder(n, "v1", 0.051) for n in range(8)], then)
    assert found.verdict == "same"
    assert {one.recordings for one in found.criteria} == {1}
    worse = [row(n, "", figure=0.051, bag=f"file:///d{n}.mcap") for n in range(8)]
    better = [row(n, "", figure=0.050, bag=f"file:///d{n}.mcap") for n in range(8)]
    assert compared(worse, better).verdict == "worse"


def test_a_file_of_a_folder_that_has_changed_since_is_named() -> None:
    then = [of_folder(n, "v1", 0.050) for n in range(8)]
    now = [of_folder(n, "v2" if n == 3 else "v1", 0.050) for n in range(8)]
    assert compared(now, then).message.endswith("; 1 played from a file that has changed since")
    # Other topics may need another file of the folder, which says nothing of it.
    other = [
        of_folder(n, "v1", 0.050) | {"parts": of_folder(9, "v9", 0)["parts"]} for n in range(8)
    ]
    assert "file" not in compared(other, then).message


def marked(mark: str, figure: float) -> list[dict[str, Any]]:
    made = [row(n, "", figure=figure) for n in range(8)]
    return [each | {"criteria": [each["criteria"][0] | {"measures": mark}]} for each in made]


def test_what_is_measured_otherwise_under_one_name_is_named_and_not_compared() -> None:
    then, now = marked("a", 0.050), marked("b", 0.080)
    for before, after in ((then, now), (now, then)):
        found = compared(after, before)
        assert (found.verdict, objections(found.as_json())) == ("same", [])
        assert found.message == (
            "no case changed of 8 cases; not compared, as something else is measured now: latency"
        )
        [one] = [each for each in found.criteria if each.name == "latency"]
        assert (one.pairs, one.recordings) == (0, 0)
    # Releases before had no mark, and latencies of slow plays in bag time.
    slowed = compared(marked("slowed-0.1-a", 0.50), marked("", 0.050))
    assert slowed.verdict == "same"
    assert slowed.message.endswith("something else is measured now: latency")
    for before in (marked("b", 0.050), marked("", 0.050)):
        assert compared(now, before).verdict == "worse"


def test_a_latency_of_a_slow_play_that_one_case_lacks_is_of_the_same() -> None:
    """A stack that crashed has no figure, and measures nothing else for that."""
    then = marked("slowed-0.5-a", 0.050)
    crashed = row(7, "", "failed", reason="StackCrashed") | {"criteria": []}
    for now, before in (([*then[:-1], crashed], then), (then, [*then[:-1], crashed])):
        found = compared(now, before)
        assert "not compared" not in found.message
        [one] = [each for each in found.criteria if each.name == "latency"]
        assert one.pairs == RECORDINGS - 1


def test_a_case_that_had_no_input_is_not_missed() -> None:
    """Of a window in which nothing was recorded this release makes no case."""
    both = marked("", 0.050)
    silent = row(8, "", "invalid", reason="NothingPlayed", quarantine={"reason": "nothing in it"})
    for before in (silent, {k: v for k, v in silent.items() if k != "quarantine"}):
        found = compared(both, [*both, before])
        assert (found.verdict, found.counts["missing"]) == ("same", 0)
        assert objections(found.as_json()) == []
    found = compared(both, [*both, row(8, "", "invalid", reason="NotEnoughEvidence")])
    assert [each.cause for each in objections(found.as_json())] == ["Missing"]
