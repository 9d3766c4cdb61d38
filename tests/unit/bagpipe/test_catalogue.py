"""A catalogue's rows and an expression over them: which recordings, and what is refused."""

import csv
import hashlib
import io
import re
import subprocess
import tempfile
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe.plan.made import Selection
from bagpipe.source.catalogue import csv_table, rows, selecting
from bagpipe.source.catalogue.choosing import Bounds, chosen
from bagpipe.source.catalogue.csv_table import CsvTable
from bagpipe.source.catalogue.faults import CatalogueError
from bagpipe.source.catalogue.parquet_table import ParquetTable
from bagpipe.source.catalogue.selecting import Choice, Selected, root_of
from bagpipe.storage import Storage

URI = "pvc://drives/2026/catalogue.csv"
CSV = """\
uri,weather,speed,night,recorded,id
a.bag,rain,7.5,true,2026-10-01T08:00:00Z,007
sub/b.bag,sun,12,false,2026-10-02T08:00:00+02:00,008
pvc://drives/c.mcap,rain,20,false,2026-10-03T08:00:00Z,009
"""


def table(path: Path, text: str = CSV) -> CsvTable:
    file = path / "catalogue.csv"
    file.write_bytes(text.encode())
    return CsvTable(file, URI)


def select(path: Path, where: str, text: str = CSV, **changed: Any) -> Selected:
    return Choice(URI, where, **changed).of(table(path, text))


@pytest.mark.parametrize(
    ("where", "names"),
    [
        ("weather == 'rain'", ["2026/a.bag", "c.mcap"]),
        ("weather == 'rain' && speed > 8", ["c.mcap"]),
        ("speed >= 12.0", ["2026/sub/b.bag", "c.mcap"]),
        ("night", ["2026/a.bag"]),
        ("recorded < timestamp('2026-10-02T07:00:00Z')", ["2026/a.bag", "2026/sub/b.bag"]),
        ("id == '007'", ["2026/a.bag"]),
        ("uri.endsWith('.mcap')", ["c.mcap"]),
        ("['sun', 'fog'].exists(w, w == weather)", ["2026/sub/b.bag"]),
        ("true", ["2026/a.bag", "2026/sub/b.bag", "c.mcap"]),
    ],
)
def test_the_rows_for_which_it_holds(tmp_path: Path, where: str, names: list[str]) -> None:
    found = select(tmp_path, where)
    assert found.uris == [f"pvc://drives/{name}" for name in names]
    assert (found.rows, found.selected) == (3, len(names))


def refusal(path: Path, where: str, text: str = CSV, **changed: Any) -> str:
    with pytest.raises(CatalogueError) as caught:
        select(path, where, text, **changed)
    return str(caught.value)


@pytest.mark.parametrize(
    ("where", "sentence"),
    [
        (
            "weathr == 'rain'",
            (
                "(weathr == 'rain') names weathr, which is no column of pvc://drives/2026/"
                "catalogue.csv: it has uri, weather, speed, night, recorded, id"
            ),
        ),
        ("[1].exists(x, weathr == 'rain')", "names weathr, which is no column of"),
        ("speed >", "is no expression: Failed to parse expression 'speed >': ERROR: <input>:1:8:"),
        ("speed", "catalogue.csv line 2: source.catalogue.where (speed) gives 7.5 and neither"),
        ("weather > 3", "catalogue.csv line 2: source.catalogue.where (weather > 3) can't be"),
        (
            "weather == 'fog'",
            (
                "selects none of the 3 rows of pvc://drives/2026/catalogue.csv (weather has text,"
                " as line 2 has 'rain')"
            ),
        ),
    ],
)
def test_an_expression_that_can_t_be_used(tmp_path: Path, where: str, sentence: str) -> None:
    assert sentence in refusal(tmp_path, where)


def test_a_cell_that_spoils_a_column_is_named(tmp_path: Path) -> None:
    text = CSV + "d.bag,rain,n/a,true,2026-10-01T08:00:00Z,010\n"
    found = refusal(tmp_path, "speed > 3.0", text)
    assert "catalogue.csv line 2: source.catalogue.where (speed > 3.0) can't be computed" in found
    assert found.endswith("(speed is '7.5', the column has text, as line 5 has 'n/a')")


def test_an_empty_cell_is_no_number(tmp_path: Path) -> None:
    text = CSV + "d.bag,,,true,2026-10-01T08:00:00Z,010\n"
    found = refusal(tmp_path, "speed > 3.0", text)
    assert "catalogue.csv line 5:" in found
    assert found.endswith("(speed is empty, the column has numbers)")
    assert len(select(tmp_path, "speed != null && speed > 3.0", text).uris) == 3
    assert select(tmp_path, "weather == ''", text).uris == ["pvc://drives/2026/d.bag"]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("name,weather\na,rain\n", "has no column uri: it has name, weather"),
        ("", "has no column uri: it has "),
        ("uri,a,a\nx,1,2\n", "line 1: two columns are called 'a': rename one"),
        ("uri,a\nx,1,2\n", "line 2 has 3 cells where the header has 2: correct it, or quote"),
        ('uri,a\nx,"1\n', "line 2 is no CSV: unexpected end of data"),
        ("uri,a\nx,1\n" + "x" * (1 << 20) + "y\n", "line 3 is longer than 1,048,576 letters"),
        ("uri,a\nx," + "y" * 70_000 + "\n", "line 2 is no CSV: field larger than field limit"),
        ("uri\n", "selects none of the 0 rows"),
    ],
)
def test_what_is_no_table(tmp_path: Path, text: str, sentence: str) -> None:
    assert sentence in refusal(tmp_path, "true", text)


def test_bytes_that_are_no_letters(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_bytes(b"uri\na.bag\n\xff\xfe.bag\n")
    with pytest.raises(CatalogueError, match="is no UTF-8 behind line"):
        Choice(URI, "true").of(CsvTable(tmp_path / "c.csv", URI))


def test_more_rows_than_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_table, "MOST_ROWS", 2)
    assert "has more than 2 rows: split the catalogue" in refusal(tmp_path, "true")


def test_more_recordings_than_are_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(selecting, "MOST_SELECTED", 2)
    assert "(true) selects more than 2 recordings of" in refusal(tmp_path, "true")


OUTSIDE = "is not within pvc://drives/: write what else the job may read into source.catalogue.w"


@pytest.mark.parametrize(
    ("uri", "sentence"),
    [
        ("", "line 2, column uri: it is empty"),
        ("x" * 1025, "line 2, column uri: it is empty, longer than 1024 letters"),
        ("a\tb.bag", "has letters that can't be shown"),
        ("../up.bag", "leaves its volume: write the path without '..'"),
        ("pvc://drives/../etc/x.bag", "leaves its volume"),
        ("ftp://host/x.bag", "has no known scheme"),
        ("s3://other/x.bag", OUTSIDE),
        ("pvc://drives2/x.bag", OUTSIDE),
        ("file:///etc/x.bag", OUTSIDE),
        ("/etc/passwd", "'/etc/passwd' has no known scheme"),
        ("*.bag", "has a wildcard, and a row is one recording"),
        ("sub//b.bag", "'pvc://drives/2026/sub//b.bag' has an empty part or '.'"),
        ("sub/./b.bag", "has an empty part or '.': write each folder once"),
        ("././b.bag", "has an empty part or '.'"),
        ("sub/.", "has an empty part or '.'"),
        ("pvc://drives//b.bag", "has an empty part or '.'"),
        ("file:////etc/x.bag", "has an empty part or '.'"),
        ("pvc://drives/results", "output.uri is inside of 'pvc://drives/results'"),
    ],
)
def test_a_row_names_nothing_that_the_job_may_not_read(
    tmp_path: Path, uri: str, sentence: str
) -> None:
    text = f"uri,n\n{uri},1\n"
    assert sentence in refusal(tmp_path, "true", text, output="pvc://drives/results/lane")


def test_a_credential_in_a_row_is_not_repeated(tmp_path: Path) -> None:
    found = refusal(tmp_path, "true", "uri\ns3://key:hunter2@drives/x.bag\n")
    assert "a URI must hold no credential" in found
    assert "hunter2" not in found


def test_what_is_not_selected_may_be_anywhere(tmp_path: Path) -> None:
    text = "uri,n\ns3://other/x.bag,1\na.bag,2\n"
    assert select(tmp_path, "n == 2", text).uris == ["pvc://drives/2026/a.bag"]


def test_other_places_are_those_of_the_spec(tmp_path: Path) -> None:
    text = "uri\ns3://other/2026/x.bag\n"
    assert select(tmp_path, "true", text, within=["s3://other/2026"]).rows == 1
    for place in ("s3://other/20", "s3://oth", "pvc://drives/"):
        assert "is not within" in refusal(tmp_path, "true", text, within=[place])


@pytest.mark.parametrize(
    ("uri", "root"),
    [
        ("pvc://drives/2026/c.csv", "pvc://drives/"),
        ("s3://bucket/a/b/c.parquet", "s3://bucket/"),
        ("hdfs://namenode:8020/c.csv", "hdfs://namenode:8020/"),
        ("file:///mnt/a/c.csv", "file:///mnt/a/"),
    ],
)
def test_a_catalogue_s_own_place(uri: str, root: str) -> None:
    assert root_of(uri) == root


def test_a_recording_that_is_named_twice_is_played_once(tmp_path: Path) -> None:
    text = "uri,scene\na.bag,1\n./a.bag,2\nb.bag,3\n"
    found = select(tmp_path, "true", text)
    assert found.uris == ["pvc://drives/2026/a.bag", "pvc://drives/2026/b.bag"]
    assert (found.rows, found.selected) == (3, 3)


ROWS = st.lists(
    st.tuples(
        st.sampled_from([f"{name}.bag" for name in "abcdefgh"]),
        st.integers(-100, 100),
        st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), max_size=8),
    ),
    min_size=1, max_size=30,
)  # fmt: skip


class InMemory:
    """A table of given rows."""

    columns = ["uri", "n", "note"]  # noqa: RUF012

    def __init__(self, given_rows: list[tuple[str, int, str]]) -> None:
        self._rows = given_rows

    def kinds(self, columns: list[str]) -> dict[str, str]:
        return dict.fromkeys(columns, "any")

    def rows(self, columns: list[str]) -> Any:
        for number, row in enumerate(self._rows, start=1):
            values = dict(zip(self.columns, row, strict=True))
            yield rows.Row(f"row {number}", row[0], {name: values[name] for name in columns})


@given(ROWS, st.integers(-100, 100), st.randoms())
def test_a_selection_is_that_of_a_filter_whatever_the_order(
    given_rows: list[tuple[str, int, str]], least: int, random: Any
) -> None:
    wanted = sorted({f"pvc://drives/2026/{uri}" for uri, n, _ in given_rows if n >= least})
    shuffled = random.sample(given_rows, len(given_rows))
    for each in (given_rows, shuffled):
        choice = Choice(URI, f"n >= {least}")
        if not wanted:
            with pytest.raises(CatalogueError, match="selects none of"):
                choice.of(InMemory(each))
            continue
        found = choice.of(InMemory(each))
        assert found.uris == wanted
        assert (found.rows, found.selected) == (
            len(given_rows), sum(n >= least for _, n, _ in given_rows)
        )  # fmt: skip


@given(ROWS)
def test_csv_and_parquet_select_the_same(given_rows: list[tuple[str, int, str]]) -> None:
    notes = [note.replace("\0", "") for _, _, note in given_rows]
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(["uri", "n", "note"])
    for (uri, n, _), note in zip(given_rows, notes, strict=True):
        writer.writerow([uri, n, f"x{note}"])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        (path / "c.csv").write_bytes(text.getvalue().encode())
        columns = {
            "uri": [uri for uri, _, _ in given_rows], "n": [n for _, n, _ in given_rows],
            "note": [f"x{note}" for note in notes],
        }  # fmt: skip
        pq.write_table(pa.table(columns), path / "c.parquet")
        choice = Choice(URI, "n > -1000 && note.startsWith('x')")
        assert choice.of(CsvTable(path / "c.csv", URI)) == choice.of(
            ParquetTable(path / "c.parquet", URI)
        )


def parquet(path: Path, **columns: Any) -> ParquetTable:
    pq.write_table(pa.table(columns), path / "c.parquet")
    return ParquetTable(path / "c.parquet", "s3://b/c.parquet")


def test_parquet_has_lists_moments_and_days(tmp_path: Path) -> None:
    made = parquet(
        tmp_path,
        uri=pa.array(["a.bag", "b.bag", None]).dictionary_encode(),
        tags=[["rain", "night"], ["sun"], []],
        at=pa.array([1_790_000_000_000_000_001, 0, 0], pa.timestamp("ns")),
        day=[date(2026, 10, 1), date(2026, 10, 2), None],
        zoned=[datetime(2026, 10, 1, tzinfo=UTC)] * 3,
        price=pa.array([1, 2, 3], pa.decimal128(5, 2)),
    )
    for where, count in {
        "'rain' in tags": 1,
        "at > timestamp('2026-01-01T00:00:00Z')": 1,
        "day != null && day >= timestamp('2026-10-01T00:00:00Z')": 2,
        "zoned == timestamp('2026-10-01T00:00:00Z') && uri != null": 2,
    }.items():
        assert len(Choice("s3://b/c.parquet", where).of(made).uris) == count, where
    for where, sentence in {
        "price > 2": "the column price is of type decimal128(5, 2), which an expression can't read",
        "true": "c.parquet row 3, column uri: it is empty",
        "size(tags) > 'x'": "c.parquet row 1: source.catalogue.where (size(tags) > 'x') can't be",
    }.items():
        with pytest.raises(CatalogueError, match=re.escape(sentence)):
            Choice("s3://b/c.parquet", where).of(made)


def test_what_is_no_parquet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "c.parquet").write_bytes(b"PAR1" + b"x" * 100 + b"PAR1")
    with pytest.raises(CatalogueError, match=r"s3://b/c.parquet is no Parquet: "):
        ParquetTable(tmp_path / "c.parquet", "s3://b/c.parquet")
    with pytest.raises(CatalogueError, match="column uri is of type int64: write text"):
        Choice("s3://b/c.parquet", "true").of(parquet(tmp_path, uri=[1]))
    monkeypatch.setattr("bagpipe.source.catalogue.parquet_table.MOST_ROWS", 2)
    with pytest.raises(CatalogueError, match="has 3 rows, and may have 2: split"):
        parquet(tmp_path, uri=["a", "b", "c"])


def test_a_cut_file_of_parquet_is_refused(tmp_path: Path) -> None:
    columns = {"uri": [f"{n}.bag" for n in range(5000)], "n": list(range(5000))}
    pq.write_table(pa.table(columns), tmp_path / "whole.parquet", row_group_size=1000)
    data = (tmp_path / "whole.parquet").read_bytes()
    outcomes = set()
    for at in range(4, len(data), len(data) // 40):
        broken = bytearray(data)
        broken[at] ^= 0xFF
        (tmp_path / "c.parquet").write_bytes(broken)
        try:
            Choice("s3://b/c.parquet", "n == 17").of(
                ParquetTable(tmp_path / "c.parquet", "s3://b/c.parquet")
            )
            outcomes.add("read")
        except CatalogueError as error:
            assert str(error).startswith(("s3://b/c.parquet", "source.catalogue.where"))
            outcomes.add("refused")
    assert "refused" in outcomes


# By the process that bounds it.


def storage(path: Path) -> Storage:
    return Storage({"drives": str(path)})


def test_the_process_answers_with_what_was_selected(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text(CSV)
    uris, selection = chosen(Choice("pvc://drives/c.csv", "night"), storage(tmp_path))
    assert uris == ["pvc://drives/a.bag"]
    sha256 = hashlib.sha256(CSV.encode()).hexdigest()
    assert selection == Selection("pvc://drives/c.csv", "night", sha256, 3, 1, 1)
    assert selection.sentence == (
        "1 recordings of 1 of 3 rows of pvc://drives/c.csv (sha256"
        f" {selection.sha256[:12]}), where night"
    )


def test_the_process_has_no_credentials(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: dict[str, str] = {}
    run = subprocess.run

    def spied(*arguments: Any, **given_: Any) -> Any:
        seen.update(given_["env"])
        return run(*arguments, **given_)

    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "hunter2")
    monkeypatch.setattr("subprocess.run", spied)
    (tmp_path / "c.csv").write_text(CSV)
    chosen(Choice("pvc://drives/c.csv", "night"), storage(tmp_path))
    assert "PATH" in seen
    assert "AWS_SECRET_ACCESS_KEY" not in seen


def process_refusal(path: Path, name: str, where: str, **bounds: int) -> str:
    with pytest.raises(CatalogueError) as caught:
        chosen(Choice(f"pvc://drives/{name}", where), storage(path), Bounds(**bounds))
    return str(caught.value)


def test_a_fault_is_reported_across_the_process(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text(CSV)
    assert "names weathr, which is no column" in process_refusal(tmp_path, "c.csv", "weathr == 1")
    gone = process_refusal(tmp_path, "gone.csv", "true")
    assert gone.startswith("source.catalogue.uri can't be read: pvc://drives/gone.csv")


def test_an_expression_without_an_end_is_ended(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text(CSV)
    tens = str(list(range(10)))
    nested = "true"
    for name in "abcdefghijk":
        nested = f"{tens}.all({name}, {nested})"
    found = process_refusal(tmp_path, "c.csv", nested, seconds=2)
    assert "takes longer than 2 s: write a simpler expression, or fewer rows" in found


def test_an_expression_that_grows_is_bounded(tmp_path: Path) -> None:
    # So large a cell that memory ends long before the time does, on a machine with other work too.
    (tmp_path / "c.csv").write_text(f"uri\na{'-' * 60_000}.bag\n")
    hundred = str(list(range(100)))
    grown = f"{hundred}.map(a, {hundred}.map(b, 'x' + uri))"
    found = process_refusal(tmp_path, "c.csv", f"size({grown}) > 0", memory=96 << 20)
    assert "takes more than 96 MiB of memory" in found


def test_a_small_file_of_large_cells_is_bounded(tmp_path: Path) -> None:
    cell = "x" * (100 << 20)
    column = pa.table({"uri": ["a.bag"] * 3, "note": [cell] * 3})
    pq.write_table(column, tmp_path / "c.parquet", compression="zstd", use_dictionary=False)
    del cell, column
    assert (tmp_path / "c.parquet").stat().st_size < 1 << 20
    found = process_refusal(tmp_path, "c.parquet", "note != ''", memory=192 << 20)
    assert "takes more than 192 MiB of memory" in found
    # What is not asked for is not read.
    uris, _ = chosen(Choice("pvc://drives/c.parquet", "true"), storage(tmp_path), Bounds(192 << 20))
    assert uris == ["pvc://drives/a.bag"]


def test_a_large_file_is_not_fetched(tmp_path: Path) -> None:
    with (tmp_path / "c.csv").open("wb") as file:
        file.truncate((256 << 20) + 1)
    found = process_refusal(tmp_path, "c.csv", "true")
    assert "has 268,435,457 bytes, and a catalogue may have 268,435,456" in found


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_million_rows_take_little_memory(tmp_path: Path, kind: str) -> None:
    count = 1_000_000
    if kind == "csv":
        with (tmp_path / "c.csv").open("w") as file:
            file.write("uri,n\n")
            file.writelines(f"{n}.bag,{n}\n" for n in range(count))
    else:
        columns = {"uri": [f"{n}.bag" for n in range(count)], "n": list(range(count))}
        pq.write_table(pa.table(columns), tmp_path / "c.parquet")
        del columns
    choice = Choice(f"pvc://drives/c.{kind}", "n % 1000 == 0")
    uris, selection = chosen(choice, storage(tmp_path), Bounds(memory=256 << 20))
    assert (len(uris), selection.rows, selection.selected) == (1000, count, 1000)
