"""What cargo-mutants' report comes to, and the copy that it breaks."""

import os
from collections import Counter
from pathlib import Path

import pytest

from tests.mutation import rust
from tests.mutation.run import ROOT


def outcome(file: str, summary: str, name: str = "") -> dict[str, object]:
    return {"scenario": {"Mutant": {"file": file, "name": name}}, "summary": summary}


def test_mutants_are_counted_by_file_and_survivors_are_named() -> None:
    found = rust.judged(
        [
            {"scenario": "Baseline", "summary": "Success"},
            outcome("a.rs", "CaughtMutant"),
            outcome("a.rs", "MissedMutant", "a.rs:7:1: replace < with <="),
            outcome("b.rs", "Timeout", "b.rs:8:1: replace + with *"),
            outcome("b.rs", "Unviable"),
        ]
    )
    assert found == {
        "a.rs": (Counter(CaughtMutant=1, MissedMutant=1), ["a.rs:7:1: replace < with <="]),
        "b.rs": (
            Counter(Timeout=1, Unviable=1),
            ["b.rs:8:1: replace + with * (ran out of time)"],
        ),
    }


def test_what_does_not_compile_is_no_mutant_and_what_ran_out_of_time_was_not_noticed() -> None:
    counts = Counter(CaughtMutant=17, Timeout=2, MissedMutant=1, Unviable=9)
    assert rust.line("a.rs", counts) == (
        "a.rs: 17 of 20 killed (85 %), 2 ran out of time, 9 do not compile"
    )


def test_files_are_named_as_they_lie_in_the_project_or_in_the_agent() -> None:
    known = {"one": ["crates/one/src/a.rs", "crates/one/src/b.rs"], "two": ["crates/two/src/c.rs"]}
    assert rust.chosen([], known) == known
    assert rust.chosen(["images/agent/crates/one/src/b.rs", "crates/two/src/c.rs"], known) == {
        "one": ["crates/one/src/b.rs"],
        "two": ["crates/two/src/c.rs"],
    }
    assert rust.chosen(["crates/one/src/a.rs"], known) == {"one": ["crates/one/src/a.rs"]}
    with pytest.raises(ValueError, match=r"^not in rust_deciders.toml: d.rs, e.rs$"):
        rust.chosen(["e.rs", "crates/one/src/a.rs", "d.rs"], known)


def test_each_file_is_there_and_in_its_crate() -> None:
    for crate, files in rust.deciders().items():
        for file in files:
            path = ROOT / rust.AGENT / file
            assert path.is_file(), file
            folder = path.parents[len(Path(file).parts) - 3]
            assert f'name = "{crate}"' in (folder / "Cargo.toml").read_text(), file


def test_only_one_crate_s_unit_tests_are_built_and_in_the_copy() -> None:
    words = rust.command("one", ["a.rs", "b.rs"], "0/4")
    assert words[:3] == ["cargo", "mutants", "--in-place"]
    assert words[words.index("--dir") + 1] == str(rust.COPY / "images/agent")
    assert [words[at + 1] for at, word in enumerate(words) if word == "--file"] == ["a.rs", "b.rs"]
    assert words[words.index("--package") + 1] == "one"
    assert "--cargo-arg=--lib" in words
    assert words[words.index("--timeout-multiplier") + 1] == "10"
    assert words[words.index("--minimum-test-timeout") + 1] == "60"
    assert words[-2:] == ["--shard", "0/4"]
    assert "--shard" not in rust.command("one", ["a.rs"], None)


def test_a_copy_keeps_the_times_of_what_is_the_same_and_mends_what_was_left_broken(
    tmp_path: Path,
) -> None:
    source, copy = tmp_path / "source", tmp_path / "copy"
    (source / "src").mkdir(parents=True)
    for name in ("same.rs", "broken.rs", "new.rs"):
        (source / "src" / name).write_text(f"// {name}")
    names = ["src/same.rs", "src/broken.rs", "src/gone.rs"]
    (source / "src" / "gone.rs").write_text("// gone")
    rust.mirror(source, names, copy)
    os.utime(copy / "src/same.rs", (1, 1))
    (copy / "src/broken.rs").write_text("// mutant")
    os.utime(copy / "src/broken.rs", (2, 2))
    (source / "src" / "gone.rs").unlink()
    os.utime(source / "src/broken.rs", (1, 1))
    rust.mirror(source, [*names, "src/new.rs"], copy)
    assert sorted(path.name for path in (copy / "src").iterdir()) == [
        "broken.rs", "new.rs", "same.rs",
    ]  # fmt: skip
    assert (copy / "src/same.rs").stat().st_mtime == 1
    assert (copy / "src/broken.rs").read_text() == "// broken.rs"
    # cargo builds what is newer than what it built: the mutant, then.
    assert (copy / "src/broken.rs").stat().st_mtime > 2
