"""Patterns find every recording once, and mean the same wherever the recordings are."""

import fnmatch
from collections.abc import Iterator
from pathlib import Path

import obstore
import pytest
from hypothesis import given
from hypothesis import strategies as st
from obstore.store import MemoryStore

from bagpipe.source.bags.expanding import recordings
from bagpipe.storage import Storage, objects
from bagpipe.storage.globs import is_of_one_folder, matcher
from bagpipe.storage.retries import Patience

METADATA = "rosbag2_bagfile_information: {}\n"


def test_a_pattern_that_matches_files_and_folders_finds_both(tmp_path: Path) -> None:
    (tmp_path / "drive1.mcap").write_text("a recording")
    for name in ("drive2", "drive3"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "metadata.yaml").write_text(METADATA)
        (tmp_path / name / f"{name}_0.mcap").write_text("a part of it")
    uris, unplanned = recordings(["pvc://r/drive*"], Storage({"r": str(tmp_path)}))
    assert unplanned == []
    # It has drive1.mcap alone: two recordings are neither planned nor reported.
    assert uris == [
        "pvc://r/drive1.mcap", "pvc://r/drive2/metadata.yaml", "pvc://r/drive3/metadata.yaml",
    ]  # fmt: skip


def test_without_the_file_the_same_pattern_finds_the_folders(tmp_path: Path) -> None:
    (tmp_path / "drive2").mkdir()
    (tmp_path / "drive2" / "metadata.yaml").write_text(METADATA)
    uris, _ = recordings(["pvc://r/drive*"], Storage({"r": str(tmp_path)}))
    assert uris == ["pvc://r/drive2/metadata.yaml"]


@pytest.mark.parametrize("pattern", ["*.{}", "**/*.{}"])
@pytest.mark.parametrize("ending", ["bag", "mcap"])
def test_a_folder_that_is_named_as_a_file_is_found_beside_one(
    tmp_path: Path, pattern: str, ending: str
) -> None:
    """`ros2 bag record -o night.mcap`, into a folder of other recordings."""
    folder, storage = tmp_path / f"night.{ending}", Storage({"r": str(tmp_path)})
    folder.mkdir()
    (folder / "metadata.yaml").write_text(METADATA)
    metadata = f"pvc://r/{folder.name}/metadata.yaml"
    named = [f"pvc://r/{pattern.format(ending)}"]
    assert recordings(named, storage) == ([metadata], [])
    (tmp_path / f"day.{ending}").write_text("a recording")
    assert recordings(named, storage) == ([f"pvc://r/day.{ending}", metadata], [])


def test_so_it_is_on_object_storage_where_no_other_folder_is_listed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    store = MemoryStore()
    images = [f"images/{n:05d}.jpg" for n in range(3000)]
    night = ["night.mcap/metadata.yaml", "night.mcap/night.mcap_0.mcap"]
    for name in ("day.mcap", "empty.mcap/x", *night, *images):
        obstore.put(store, name, b"x")
    monkeypatch.setattr(objects, "_store", lambda *_args, **_more: store)
    backend = objects.ObjectBackend("s3", "fleet", Patience())
    monkeypatch.setattr(backend, "_below", None)
    monkeypatch.setattr("bagpipe.storage.kinds._remote", lambda *_args: backend)
    found, _ = recordings(["s3://fleet/*.mcap"], Storage({}))
    assert found == ["s3://fleet/day.mcap", "s3://fleet/night.mcap/metadata.yaml"]
    monkeypatch.setattr(backend, "_in", None)
    assert recordings(["s3://fleet/night.mcap"], Storage({}))[0] == found[1:]


def test_a_recording_that_two_claims_reach_is_one(tmp_path: Path) -> None:
    """--volume recordings=/data --volume more=/data."""
    (tmp_path / "m.bag").touch()
    storage = Storage({"recordings": str(tmp_path), "more": str(tmp_path)})
    elsewhere = ["s3://fleet/m.bag", "s3://more/m.bag"]
    uris = ["pvc://recordings/m.bag", *elsewhere, "pvc://more/m.bag", f"file://{tmp_path}/m.bag"]
    assert storage.each_once(uris) == uris[:3]


def test_a_recording_is_counted_once_whatever_links_lead_to_it(tmp_path: Path) -> None:
    (tmp_path / "2026-11-24").mkdir()
    (tmp_path / "2026-11-24" / "a.bag").write_text("a recording")
    (tmp_path / "latest").symlink_to("2026-11-24")
    uris, _ = recordings(["pvc://r/*/*.bag"], Storage({"r": str(tmp_path)}))
    deep, _ = recordings(["pvc://r/**/*.bag"], Storage({"r": str(tmp_path)}))
    assert deep == ["pvc://r/2026-11-24/a.bag"]
    assert uris == deep


@pytest.mark.parametrize("link", ["latest.bag", "a-link.bag"])
@pytest.mark.parametrize("pattern", ["*.bag", "[a-z]*", "?*.bag"])
def test_a_file_and_a_link_to_it_are_one_recording(tmp_path: Path, link: str, pattern: str) -> None:
    """By its own name, whichever comes first."""
    (tmp_path / "drive.bag").write_text("a recording")
    (tmp_path / link).symlink_to("drive.bag")
    uris, _ = recordings([f"pvc://r/{pattern}"], Storage({"r": str(tmp_path)}))
    assert uris == ["pvc://r/drive.bag"]


def test_brackets_alone_make_a_pattern(tmp_path: Path) -> None:
    for name in "abc":
        (tmp_path / f"{name}.bag").write_text("a recording")
    storage = Storage({"r": str(tmp_path)})
    assert storage.expand("pvc://r/[ab].bag") == ["pvc://r/a.bag", "pvc://r/b.bag"]


def test_the_folder_that_stands_for_a_claim_may_have_any_name(tmp_path: Path) -> None:
    folder = tmp_path / "drives [november]"
    folder.mkdir()
    (folder / "a.bag").write_text("a recording")
    storage = Storage({"r": str(folder)})
    assert storage.exists("pvc://r/a.bag")
    assert storage.expand("pvc://r/*.bag") == ["pvc://r/a.bag"]


def test_no_pattern_reaches_the_folder_beside_the_one_of_the_claim(tmp_path: Path) -> None:
    for name in ("set[12]", "set1"):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name[:4]}.bag").write_text("a recording")
    storage = Storage({"r": str(tmp_path / "set[12]")})
    assert storage.expand("pvc://r/*.bag") == ["pvc://r/set[.bag"]


def test_what_a_pattern_found_is_found_again_by_its_own_uri(tmp_path: Path) -> None:
    """`bagpipe replay` plans a case again from its recording's URI alone."""
    (tmp_path / "drive [1].bag").write_text("a recording")
    storage = Storage({"r": str(tmp_path)})
    found, _ = recordings(["pvc://r/*.bag"], storage)
    assert found == ["pvc://r/drive [1].bag"]
    assert recordings(found, storage) == (found, [])


def test_one_pattern_means_the_same_on_volumes_and_on_object_storage(tmp_path: Path) -> None:
    for name in ("a.bag", ".b.bag"):
        (tmp_path / name).write_text("a recording")
    here = Storage({"r": str(tmp_path)}).expand("pvc://r/*.bag")
    there = [name for name in ("a.bag", ".b.bag") if matcher("*.bag")(name)]
    assert [uri.removeprefix("pvc://r/") for uri in here] == there


def test_a_pattern_that_volumes_take_is_no_bug_on_object_storage() -> None:
    # On a volume ** beside other letters is as one star (test_storage_links: "a**/x.bag").
    assert matcher("a**/x.bag")("ab/x.bag")


def test_a_pattern_within_one_folder_lists_no_other_folder_of_a_bucket(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """`s3://fleet/*.bag` over a bucket whose folders hold millions of objects."""
    store = MemoryStore()
    for name in ("a.bag", *(f"images/{n:05d}.jpg" for n in range(3000))):
        obstore.put(store, name, b"x")
    monkeypatch.setattr(objects, "_store", lambda *_args, **_more: store)
    backend = objects.ObjectBackend("s3", "fleet", Patience())
    looked: list[str] = []
    below = backend._below

    def counted(folder: str) -> Iterator[str]:
        for path in below(folder):
            looked.append(path)
            yield path

    monkeypatch.setattr(backend, "_below", counted)
    assert backend.glob("*.bag") == ["a.bag"]
    assert len(looked) < 10, f"{len(looked)} objects were listed for one"
    assert backend.glob("images/0000?.jpg") == [f"images/{n:05d}.jpg" for n in range(10)]
    assert backend.glob("*/00000.jpg") == ["images/00000.jpg"]
    assert backend.names("") == ["images", "a.bag"]


@pytest.mark.parametrize(
    ("pattern", "one"),
    [("*.bag", True), ("a/b/*.bag", True), ("a/**.bag", True), ("**", False), ("a/**", False),
     ("a/*/b.bag", False), ("a/**/b.bag", False), ("a/b.bag", True)],
)  # fmt: skip
def test_which_patterns_stay_in_one_folder(pattern: str, one: bool) -> None:
    assert is_of_one_folder(pattern) is one


NAMES = st.text("ab.", min_size=1, max_size=3).filter(lambda name: set(name) != {"."})
PARTS = st.one_of(NAMES, st.sampled_from(["*", "**", "a*", "?b", "[ab]", "*.a", ".*"]))


@given(st.lists(PARTS, min_size=1, max_size=4), st.lists(NAMES, min_size=1, max_size=4))
def test_patterns_match_as_python_s_own_do(parts: list[str], names: list[str]) -> None:
    assert matcher("/".join(parts))("/".join(names)) == by_trial(
        [*parts, "*"] if parts[-1] == "**" else parts, names
    )


def by_trial(parts: list[str], names: list[str]) -> bool:
    """The same rules, tried one way after the other."""
    if not parts:
        return not names
    if parts[0] == "**":
        deeper = bool(names) and not names[0].startswith(".") and by_trial(parts, names[1:])
        return by_trial(parts[1:], names) or deeper
    if not names or not fnmatch.fnmatchcase(names[0], parts[0]):
        return False
    hidden = names[0].startswith(".") and not parts[0].startswith(".")
    return not hidden and by_trial(parts[1:], names[1:])


def test_a_pattern_of_many_stars_costs_no_time_of_powers() -> None:
    assert not matcher("/".join(["**", "a"] * 20 + ["b"]))("/".join(["a"] * 60))


@pytest.mark.parametrize(
    ("given", "below"), [("latest", ""), ("", "latest/")], ids=["of the claim", "in the pattern"]
)
def test_a_recording_keeps_its_own_name_below_a_folder_that_is_a_link_too(
    tmp_path: Path, given: str, below: str
) -> None:
    """`bagpipe run --volume r=/data`, where /data is a link to the disk; or `latest/*.bag`."""
    (tmp_path / "disk").mkdir()
    (tmp_path / "latest").symlink_to("disk")
    for n in range(40):
        (tmp_path / "disk" / f"newest-{n:02d}.bag").symlink_to(f"drive-{n:02d}.bag")
        (tmp_path / "disk" / f"drive-{n:02d}.bag").write_text("a recording")
    found, _ = recordings([f"pvc://r/{below}*.bag"], Storage({"r": str(tmp_path / given)}))
    assert found == [f"pvc://r/{below}drive-{n:02d}.bag" for n in range(40)]


def test_two_names_of_one_input_are_two_cases_of_a_program(tmp_path: Path) -> None:
    """source.files of the engine exec: the name says to the program what it is to do."""
    (tmp_path / "rain.json").write_text("{}")
    (tmp_path / "night.json").symlink_to("rain.json")
    found = Storage({"r": str(tmp_path)}).expand("pvc://r/*.json")
    assert found == ["pvc://r/night.json", "pvc://r/rain.json"]
