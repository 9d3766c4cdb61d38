"""From rows to results: what a commit makes of them, whoever lives to finish it."""

import json
from pathlib import Path
from typing import Any

import pytest

from bagpipe.driver import job as driver
from bagpipe.driver.artefacts import Artefacts
from bagpipe.driver.journal import Journal
from bagpipe.driver.keep import Keeper
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import results_uri
from bagpipe.run.case_run import unplanned_row
from bagpipe.storage import Storage, StorageError
from tests.unit.bagpipe.drivers import MISSING, World, finish, ran
from tests.unit.bagpipe.places import By, nothing


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


# Promise: readers-trust-the-manifest
def test_the_manifest_names_what_counts_and_the_rest_is_removed(world: World) -> None:
    for name in ("a.bag", "b.bag", "stale.bag"):
        world.record(name)
    keeper, journal = world.driver()
    keeper.take([ran("b"), ran("a"), ran("a", recorded="cases/stale.bag"), unplanned_row(MISSING)])
    finish(keeper)
    manifest = world.results.commit(keeper.rows, keeper.progress, journal.driver)
    world.results.publish(manifest, keeper.rows.rows, journal)
    assert world.names("cases") == ["a.bag", "b.bag"]
    assert world.names("journal") == []
    assert [(c["case"], c["outcome"], c["recorded"]) for c in manifest["cases"]] == [
        ("a", "passed", "cases/a.bag"),
        ("b", "passed", "cases/b.bag"),
        ("lost", "errored", None),
    ]
    assert json.loads((world.folder / "manifest.json").read_text()) == manifest
    assert [row["case"] for row in world.lines()] == ["a", "b", "lost"]


# Promise: manifest-once
def test_of_two_drivers_one_commits_and_the_other_adopts(world: World) -> None:
    for name in ("a.bag", "a-too.bag"):
        world.record(name)
    one, journal_one = world.driver()
    two, journal_two = world.driver()
    one.take([ran("a")])
    two.take([ran("a", recorded="cases/a-too.bag")])
    finish(one)
    finish(two)
    won = world.results.commit(two.rows, two.progress, journal_two.driver)
    lost = world.results.commit(one.rows, one.progress, journal_one.driver)
    assert lost == won
    assert won["driver"] == journal_two.driver
    # The one that lost may have to publish what the one that won did not live to.
    world.results.publish(lost, journal_one.rows, journal_one)
    assert [row["recorded"] for row in world.lines()] == ["cases/a-too.bag"]
    assert world.names("cases") == ["a-too.bag"]


def committed(world: World) -> tuple[dict[str, Any], Keeper, Journal]:
    """A driver that has committed two cases, in two segments of its journal."""
    for name in ("a.bag", "b.bag", "stale.bag"):
        world.record(name)
    keeper, journal = world.driver()
    keeper.progress.begin(2)
    for name in ("a", "b"):
        keeper.take([ran(name)])
        finish(keeper)
    manifest = world.results.commit(keeper.rows, keeper.progress, journal.driver)
    return manifest, keeper, journal


def assert_adopted(world: World) -> None:
    """Another driver finishes what the one that committed did not live to."""
    progress = Progress(results_uri(world.job))
    assert driver.run(world.job, progress, By(nothing))
    assert progress.verdict == "Passed"
    assert [row["case"] for row in world.lines()] == ["a", "b"]
    assert world.names("cases") == ["a.bag", "b.bag"]
    assert world.names("journal") == []
    assert (world.folder / "junit.xml").read_text().count("<testcase ") == 2
    assert (world.folder / "results.parquet").exists()
    assert (world.folder / "report.html").exists()


def killed(*_arguments: object) -> None:
    raise SystemExit


# Promise: successor-finishes
def test_what_a_driver_left_unpublished_another_one_finishes(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    manifest, keeper, journal = committed(world)
    with monkeypatch.context() as patch, pytest.raises(SystemExit):
        patch.setattr(Artefacts, "store", killed)
        world.results.publish(manifest, keeper.rows.rows, journal)
    assert (world.folder / "results.jsonl").exists()
    assert not world.results.is_published(journal)
    assert_adopted(world)
    assert world.results.is_published(journal)


def test_a_journal_that_is_half_removed_takes_no_line_away(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    manifest, keeper, journal = committed(world)
    with monkeypatch.context() as patch, pytest.raises(SystemExit):
        patch.setattr(Journal, "remove", killed)
        world.results.publish(manifest, keeper.rows.rows, journal)
    first = world.names("journal")[0]
    world.storage.remove(f"{results_uri(world.job)}/journal/{first}")
    assert_adopted(world)


def test_lines_are_published_all_or_not_at_all(world: World) -> None:
    manifest, _, journal = committed(world)
    first = world.names("journal")[0]
    world.storage.remove(f"{results_uri(world.job)}/journal/{first}")
    with pytest.raises(StorageError, match=r"results\.jsonl .* no row of case a"):
        world.results.publish(manifest, journal.rows, journal)
    assert not (world.folder / "results.jsonl").exists()
    assert len(world.names("journal")) == 1


def test_a_manifest_says_whose_job_it_is_and_what_became_of_it(world: World) -> None:
    keeper, journal = world.driver()
    keeper.progress.begin(2)
    crash = {"reason": "StackCrashed", "message": "x" * 400, "seconds": 1.5, "ledger": {}}
    keeper.take([ran("b", discarded=[crash], attempts=2), ran("a", "failed", reason="Bad")])
    finish(keeper)
    manifest = world.results.commit(keeper.rows, keeper.progress, journal.driver)
    chosen = {
        key: manifest[key] for key in ("schema", "job", "attempt", "driver", "phase", "verdict")
    }
    assert chosen == {
        "schema": "sim.bagpipe.io/manifest/v1alpha1",
        "job": {"name": "drive", "namespace": "lab", "uid": "uid-1"},
        "attempt": 1,
        "driver": journal.driver,
        "phase": "Complete",
        "verdict": "Failed",
    }
    # In short: a manifest is read whole, and a row's ledgers are in results.jsonl.
    short = crash | {"message": "x" * 300}
    del short["ledger"]
    assert manifest["cases"] == [
        {"case": "a", "outcome": "failed", "reason": "Bad", "recorded": None, "attempts": 1,
         "starts": None, "discarded": [], "quarantined": False},
        {"case": "b", "outcome": "passed", "reason": "", "recorded": "cases/b.bag", "attempts": 2,
         "starts": None, "discarded": [short], "quarantined": False},
    ]  # fmt: skip
    assert (manifest["counts"]["passed"], manifest["counts"]["discarded"]) == (1, 1)


def test_a_manifest_says_from_when_to_when_its_job_ran(world: World) -> None:
    keeper, journal = world.driver()
    keeper.progress.began, keeper.progress.ended = 86_400.0, 86_490.5
    keeper.progress.begin(1)
    keeper.take([ran("a")])
    finish(keeper)
    provenance = world.results.commit(keeper.rows, keeper.progress, journal.driver)["provenance"]
    assert [provenance[name] for name in ("began", "ended", "seconds")] == [
        "1970-01-02T00:00:00Z", "1970-01-02T00:01:30Z", 90.5,
    ]  # fmt: skip


def test_what_counts_is_found_whatever_the_order_of_a_manifest_s_fields(world: World) -> None:
    """A driver of another release may write them in another one."""
    manifest, keeper, journal = committed(world)
    turned = [dict(reversed(entry.items())) for entry in manifest["cases"]]
    world.results.publish(manifest | {"cases": turned}, keeper.rows.rows, journal)
    assert [row["case"] for row in world.lines()] == ["a", "b"]


def test_a_manifest_is_for_people_too_and_is_read_up_to_a_gibibyte(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    committed(world)
    text = (world.folder / "manifest.json").read_text()
    assert text.startswith('{\n "schema": "sim.bagpipe.io/manifest/v1alpha1",\n "job": {\n  "name"')
    most: list[int] = []

    def read_all(_storage: Storage, uri: str, bytes_at_most: int) -> bytes:
        most.append(bytes_at_most)
        return (world.folder / uri.rpartition("/")[2]).read_bytes()

    monkeypatch.setattr(Storage, "read_all", read_all)
    assert world.results.committed() == json.loads(text)
    assert most == [1024**3]


def test_nothing_is_committed_without_a_manifest_and_a_broken_one_is_reported(
    world: World,
) -> None:
    assert not world.results.is_committed()
    assert world.results.committed() is None
    with world.storage.create(f"{world.results.folder}/manifest.json") as file:
        file.write(b'{"counts": ')
    assert world.results.is_committed()
    with pytest.raises(StorageError, match=r"manifest\.json is no JSON: "):
        world.results.committed()


def test_a_line_says_what_it_is_a_line_of(world: World) -> None:
    manifest, keeper, journal = committed(world)
    assert not world.results.is_published(journal)
    world.results.publish(manifest, keeper.rows.rows, journal)
    assert [row["schema"] for row in world.lines()] == ["sim.bagpipe.io/case/v1alpha1"] * 2
    assert world.results.is_published(journal)
    # A driver that comes late may leave rows, which somebody must take away.
    journal.append([ran("a")])
    assert not world.results.is_published(journal)


def test_a_case_that_is_kept_twice_has_one_line(world: World) -> None:
    manifest, keeper, journal = committed(world)
    rows = list(keeper.rows.rows())
    world.results.publish(manifest, lambda: [*rows, *rows], journal)
    assert [row["case"] for row in world.lines()] == ["a", "b"]
