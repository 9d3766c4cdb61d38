"""A job's journal: rows come back as they were kept, and what is no row names its line."""

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from bagpipe.driver import journal as journal_module
from bagpipe.driver.journal import Journal
from bagpipe.storage import Storage, StorageError

RESULTS = "pvc://results/out"


@pytest.fixture
def storage(tmp_path: Path) -> Storage:
    return Storage({"results": str(tmp_path)})


def named(storage: Storage) -> list[str]:
    return storage.names(f"{RESULTS}/journal")


def test_rows_come_back_by_attempt_and_then_as_they_were_kept(storage: Storage) -> None:
    again = Journal(storage, RESULTS, 12, "b")
    again.append([{"case": "four"}])
    first = Journal(storage, RESULTS, 2, "c")
    first.append([{"case": "one", "outcome": "passed"}, {"case": "two"}])
    first.append([{"case": "three"}])
    assert named(storage) == [
        "0002-c-000000.jsonl", "0002-c-000001.jsonl", "0012-b-000000.jsonl",
    ]  # fmt: skip
    taken_over = Journal(storage, RESULTS, 13)
    assert list(taken_over.rows()) == [
        {"case": "one", "outcome": "passed"}, {"case": "two"}, {"case": "three"}, {"case": "four"},
    ]  # fmt: skip


def test_two_drivers_of_one_attempt_keep_rows_beside_each_other(storage: Storage) -> None:
    for name in ("a", "b", "c"):
        Journal(storage, RESULTS, 1).append([{"case": name}])
    assert sorted(row["case"] for row in Journal(storage, RESULTS, 1).rows()) == ["a", "b", "c"]


def test_a_segment_may_be_as_large_as_a_few_seconds_rows(storage: Storage) -> None:
    journal = Journal(storage, RESULTS, 1)
    row = {"case": "a", "message": "x" * (1 << 20)}
    journal.append([row] * 8)
    assert sum(row == each for each in journal.rows()) == 8


def test_a_segment_that_was_not_written_leaves_nothing_of_it(
    storage: Storage,
) -> None:
    journal = Journal(storage, RESULTS, 1, "a")
    journal.append([{"case": "one"}])
    with pytest.raises(TypeError):
        journal.append([{"case": "two", "odd": object()}])
    journal.append([{"case": "two"}])
    assert named(storage) == ["0001-a-000000.jsonl", "0001-a-000002.jsonl"]
    assert [row["case"] for row in journal.rows()] == ["one", "two"]


def test_a_journal_is_empty_until_something_is_kept_and_when_all_is_removed(
    storage: Storage, tmp_path: Path
) -> None:
    journal = Journal(storage, RESULTS, 1)
    assert journal.is_empty()
    journal.append([{"case": "one"}])
    journal.append([{"case": "two"}])
    (tmp_path / "out/journal/notes.txt").write_text("somebody's own")
    assert not journal.is_empty()
    journal.remove()
    assert journal.is_empty()
    # What is no segment is not the journal's.
    assert (named(storage), list(journal.rows())) == (["notes.txt"], [])


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('{"case": "tw', "line 2 is no row of a journal"),
        ("[1]", "line 2 names no case"),
        ("7", "line 2 names no case"),
        ('{"outcome": "passed"}', "line 2 names no case"),
        ('{"case": 7}', "line 2 names no case"),
    ],
)
def test_a_line_that_is_no_row_is_named_with_the_way_out(
    storage: Storage, tmp_path: Path, line: str, words: str
) -> None:
    journal = Journal(storage, RESULTS, 1, "a")
    journal.append([{"case": "one"}])
    (segment,) = (tmp_path / "out/journal").iterdir()
    segment.write_text(segment.read_text() + line + "\n")
    with pytest.raises(StorageError) as refused:
        list(journal.rows())
    sentence = str(refused.value)
    assert sentence.startswith(f"{RESULTS}/journal/0001-a-000000.jsonl {words}")
    assert sentence.endswith("remove the file, and its cases run again")


def test_a_segment_larger_than_any_that_a_driver_keeps_is_not_read(
    storage: Storage, tmp_path: Path
) -> None:
    journal = Journal(storage, RESULTS, 1)
    journal.append([{"case": "one"}])
    (segment,) = (tmp_path / "out/journal").iterdir()
    with segment.open("r+b") as file:
        file.truncate((256 << 20) + 1)  # takes no room: it is a hole
    with pytest.raises(StorageError, match="has 268435457 bytes where at most 268435456"):
        list(journal.rows())


def test_each_try_writes_under_a_name_of_its_own(
    storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A write that was given up may still come, and would undo what was written after it."""
    late: list[Callable[[], None]] = []
    create = Storage.create

    @contextmanager
    def slow(_: Storage, uri: str) -> Iterator[Any]:
        rows = io.BytesIO()
        yield rows

        def arrives() -> None:
            with create(storage, uri) as file:
                file.write(rows.getvalue())

        late.append(arrives)
        raise StorageError(f"{uri} can't be written: it did not end in time")

    journal = Journal(storage, RESULTS, 1, "a")
    monkeypatch.setattr(Storage, "create", slow)
    with pytest.raises(StorageError, match="in time"):
        journal.append([{"case": "one"}])
    monkeypatch.setattr(Storage, "create", create)
    journal.append([{"case": "one"}, {"case": "two", "outcome": "failed"}])
    late[0]()
    rows = {row["case"]: row for row in Journal(storage, RESULTS, 2).rows()}
    assert rows == {"one": {"case": "one"}, "two": {"case": "two", "outcome": "failed"}}


def test_many_rows_are_several_segments_that_the_next_driver_can_read(
    storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal_module, "_SEGMENT_BYTES", 100)
    monkeypatch.setattr(journal_module, "_MAX_SEGMENT_BYTES", 300)
    rows = [{"case": f"{n:04d}", "message": "x" * size} for n, size in enumerate([9] * 20 + [250])]
    journal, left = Journal(storage, RESULTS, 1, "a"), list(rows)
    while left:
        del left[: journal.append(left)]
    assert list(Journal(storage, RESULTS, 2).rows()) == rows
    sizes = [storage.size(f"{RESULTS}/journal/{name}") for name in named(storage)]
    # Two rows of 41 bytes each, and one that is larger by itself.
    assert sizes == [82] * 10 + [282]
