"""A job over a catalogue: its cases, what its results say of them, and another driver of it."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.driver.journal import Journal
from bagpipe.driver.own_pods import Seen
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import Results
from bagpipe.driver.row_file import RowFile
from bagpipe.driver.same_catalogue import check_selection
from bagpipe.plan.made import Selection
from bagpipe.report.provenance import facts_of
from bagpipe.source.catalogue.faults import CatalogueError
from bagpipe.source.chosen import source_of
from bagpipe.source.planning import plan
from bagpipe.spec import claims, storage_uris
from bagpipe.storage import Storage, StorageUnfitError
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.jobs import make_job, make_row, make_spec

RAIN = Selection("pvc://r/c.csv", "weather == 'rain'", "ab" * 32, 3, 2, 2)


def catalogue(folder: Path, text: str) -> Storage:
    for name in ("a", "b", "c"):
        write_bag(folder / f"{name}.bag", steady("/scan", 20, 100_000_000))
    (folder / "c.csv").write_text(text)
    return Storage({"r": str(folder)})


def source(where: str, **changed: Any) -> dict[str, Any]:
    own = {"uri": "pvc://r/c.csv", "where": where} | changed
    return {"catalogue": own, "topics": ["/scan"], "fragment": {"length": "1s"}}


def test_the_cases_are_those_of_the_same_bags(tmp_path: Path) -> None:
    storage = catalogue(tmp_path, "weather,uri\nrain,b.bag\nsun,c.bag\nrain,a.bag\n")
    found = plan(make_spec(source=source("weather == 'rain'")), storage)
    bags = {"bags": ["pvc://r/a.bag", "pvc://r/b.bag"]}
    same = plan(make_spec(source=source("true") | bags | {"catalogue": None}), storage)
    assert [case.id for case in found.cases] == ["a-0000", "a-0001", "b-0000", "b-0001"]
    assert (found.cases, found.unplanned) == (same.cases, same.unplanned)
    assert found.selection is not None
    assert (found.selection.rows, found.selection.selected, found.selection.recordings) == (3, 2, 2)
    assert same.selection is None


def test_a_row_more_leaves_the_others_cases_their_names(tmp_path: Path) -> None:
    """So that tonight's comparison and quarantine are of the recordings of the night before."""
    for folder in ("w", "x", "y"):
        (tmp_path / folder).mkdir()
        write_bag(tmp_path / folder / "lidar.bag", steady("/scan", 10, 100_000_000))
    storage = catalogue(tmp_path, "uri,n\nx/lidar.bag,1\ny/lidar.bag,1\n")
    spec = make_spec(source=source("n == 1"))
    before = {case.id: case.bag for case in plan(spec, storage).cases}
    (tmp_path / "c.csv").write_text("uri,n\nw/lidar.bag,1\nx/lidar.bag,1\ny/lidar.bag,1\n")
    after = {case.id: case.bag for case in plan(spec, storage).cases}
    assert (len(before), len(after)) == (2, 3)
    assert before.items() < after.items()


def test_a_recording_that_is_not_there_is_no_case(tmp_path: Path) -> None:
    storage = catalogue(tmp_path, "uri,n\na.bag,1\ngone.bag,1\n")
    found = plan(make_spec(source=source("n == 1")), storage)
    assert [(each.bag, each.reason) for each in found.unplanned] == [
        ("pvc://r/gone.bag", "BagMissing")
    ]


def test_a_case_is_planned_again_without_the_catalogue(tmp_path: Path) -> None:
    storage = catalogue(tmp_path, "uri,n\na.bag,1\nb.bag,1\n")
    spec = make_spec(source=source("n == 1"))
    alone = source_of(spec).alone("pvc://r/b.bag")
    assert alone is not None
    (tmp_path / "c.csv").unlink()
    again = plan(spec.model_copy(update={"source": alone}), storage)
    assert [case.id for case in again.cases] == ["b-0000", "b-0001"]


def test_rights_and_volumes_follow_from_the_spec_alone() -> None:
    spec = make_spec(source=source("true", within=["s3://drives/2026/", "pvc://archive/"]))
    assert storage_uris(spec) == [
        "pvc://r/c.csv", "s3://drives/2026/", "pvc://archive/", "pvc://results/out"
    ]  # fmt: skip
    assert claims(spec) == {"r": True, "archive": True, "results": False}


@pytest.mark.parametrize(
    ("own", "sentence"),
    [
        ({"uri": "pvc://r/*.csv"}, "is no catalogue: write the URI of one .csv or .parquet"),
        ({"uri": "pvc://r/c.json"}, "is no catalogue"),
        ({"uri": "s3://k:s@b/c.csv"}, "must hold no credential"),
        ({"where": " "}, "String should match pattern"),
        ({"where": "x" * 2049}, "at most 2048 characters"),
        ({"within": ["pvc://r/*/"]}, "has a wildcard: write a folder"),
        ({"within": ["pvc://r/../x/"]}, "leaves its volume"),
        ({"within": ["pvc://r/"] * 2}, "is there twice"),
    ],
)
def test_what_is_no_catalogue_is_refused(own: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        make_spec(source={"catalogue": {"uri": "pvc://r/c.csv", "where": "true"} | own})


def test_another_driver_goes_by_the_same_catalogue(tmp_path: Path) -> None:
    storage = Storage({"results": str(tmp_path)})
    check_selection(storage, "pvc://results/x", RAIN)
    check_selection(storage, "pvc://results/x", RAIN)
    kept = json.loads((tmp_path / "x/catalogue.json").read_text())
    assert (kept["sha256"], kept["rows"], kept["where"]) == (RAIN.sha256, 3, RAIN.where)
    changed = Selection("pvc://r/c.csv", "weather == 'rain'", "cd" * 32, 4, 2, 2)
    with pytest.raises(CatalogueError, match="has changed since the job began"):
        check_selection(storage, "pvc://results/x", changed)
    (tmp_path / "x/catalogue.json").write_text("{}")
    with pytest.raises(StorageUnfitError, match="does not say by which catalogue the job began"):
        check_selection(storage, "pvc://results/x", RAIN)


def test_results_say_by_which_rows_they_are(tmp_path: Path) -> None:
    storage = Storage({"results": str(tmp_path)})
    progress = Progress("r")
    progress.begin(1)
    progress.select(RAIN)
    with RowFile(tmp_path / "rows") as rows:
        rows.add(make_row("a"))
        progress.add(make_row("a"))
        results = Results(make_job(storage.volumes), storage)
        journal = Journal(storage, results.folder, 1)
        manifest = results.commit(rows, progress, journal.driver, Seen())
        results.publish(manifest, rows.rows, journal)
    assert manifest["provenance"]["catalogue"] == {
        "catalogue": "pvc://r/c.csv", "where": "weather == 'rain'", "sha256": "ab" * 32,
        "rows": 3, "selected": 2, "recordings": 2,
    }  # fmt: skip
    assert dict(facts_of(manifest))["catalogue"] == (
        f"2 recordings of 2 of 3 rows of pvc://r/c.csv (sha256 {'ab' * 32}), where weather =="
        " 'rain'"
    )
    shown = CliRunner().invoke(main, ["results", str(tmp_path / "out/drive/uid-1")])
    assert "catalogue: 2 recordings of 2 of 3 rows of pvc://r/c.csv (sha256" in shown.output
    assert "2 recordings of 2 of 3 rows" in (tmp_path / "out/drive/uid-1/junit.xml").read_text()
