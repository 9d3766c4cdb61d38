"""`bagpipe pull` reads results from every kind of storage that this machine reaches."""

from pathlib import Path

import pytest

from bagpipe.cli.pulling.entry import PullError
from bagpipe.cli.pulling.stored import StoredFolder
from bagpipe.cli.pulling.target import Origin, target_at
from tests.integration.storage.conftest import Place

CONTENTS = {"manifest.json": b"{}", "cases/a.1.bag": bytes(9 << 20), "cases/of/b c": b""}


def test_all_files_come_as_they_are(place: Place, tmp_path: Path) -> None:
    for name, data in CONTENTS.items():
        with place.storage.create(f"{place.uri}/{name}") as file:
            file.write(data)
    source = StoredFolder(place.uri, place.storage)
    entries, left_out = source.listed()
    assert {e.name: e.size for e in entries} == {n: len(data) for n, data in CONTENTS.items()}
    assert left_out == []
    origin = Origin("robots", "lane", "uid-1", place.uri)
    with target_at(tmp_path / "here", origin) as target:
        for entry, pieces in source.sent(entries):
            with target.file(entry) as write:
                for piece in pieces:
                    write(piece)
        assert target.missing(source.listed()[0]) == []
    for name, data in CONTENTS.items():
        assert (tmp_path / "here" / name).read_bytes() == data
    with pytest.raises(PullError, match="has no files, or is not there"):
        StoredFolder(f"{place.uri}-gone", place.storage).listed()
