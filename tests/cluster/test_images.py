"""When an image has to be built again, and what its archive's record is worth."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import threading
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import build
import claim
import context
import engines
import pytest
from context import IMAGES, Image
from failure import BuildError
from lock import LockError, locked


@pytest.fixture
def image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Image:
    monkeypatch.setenv("BAGPIPE_CACHE", str(tmp_path / "cache"))
    (tmp_path / "Dockerfile").write_text("FROM scratch\n")

    def stage(folder: Path) -> None:
        (folder / "program").write_text("one")
        (folder / "program").chmod(0o755)

    return Image("probe", tmp_path / "Dockerfile", stage)


def test_the_names_are_those_of_the_contract() -> None:
    assert {i.reference for i in IMAGES} == {
        "bagpipe.local/agent:0.2.0",
        "bagpipe.local/example-nodes:0.2.0",
        "bagpipe.local/barrier-car:0.2.0",
        "bagpipe.local/exec-highway:0.2.0",
        "bagpipe.local/operator:0.2.0",
        "bagpipe.local/robot-state-publisher:0.2.0",
        "bagpipe.local/ros:0.2.0",
        "bagpipe.local/ros2-rclpy:0.2.0",
        "bagpipe.local/ros2-standin:0.2.0",
        "bagpipe.local/spark:0.2.0",
    }


def test_the_same_content_has_the_same_hash(image: Image) -> None:
    first = context.content(image, context.stage(image), "base")
    assert context.content(image, context.stage(image), "base") == first
    assert len(first) == 64


def test_the_hash_follows_all_that_decides(image: Image, tmp_path: Path) -> None:
    folder = context.stage(image)
    hashes = {context.content(image, folder, "base"), context.content(image, folder, "other")}
    (folder / "program").write_text("two")
    hashes.add(context.content(image, folder, "base"))
    (folder / "program").chmod(0o644)
    hashes.add(context.content(image, folder, "base"))
    (tmp_path / "Dockerfile").write_text("FROM scratch\nENV A=1\n")
    hashes.add(context.content(image, context.stage(image), "base"))
    assert len(hashes) == 5


def test_staged_files_have_one_time_and_plain_modes(image: Image) -> None:
    folder = context.stage(image)
    found = {p.name: (p.stat().st_mtime, p.stat().st_mode & 0o777) for p in folder.iterdir()}
    assert found == {"program": (context.EPOCH, 0o755), "Dockerfile": (context.EPOCH, 0o644)}


def test_an_incomplete_archive_does_not_count(image: Image) -> None:
    archive = build.archive_of(image)
    archive.parent.mkdir(parents=True)
    assert build.recorded(image) == ""
    archive.write_bytes(b"12345")
    record = {"image": image.reference, "content": "abc", "size": 5}
    archive.with_suffix(".json").write_text(json.dumps(record))
    assert build.recorded(image) == "abc"
    archive.write_bytes(b"123")
    assert build.recorded(image) == ""


class Sequencer:
    """An engine whose builds wait for each other: it ends only if they run at once."""

    def __init__(self, together: int) -> None:
        self.barrier = threading.Barrier(together, timeout=90)
        self.built: list[str] = []

    def base(self) -> str:
        return "base"

    def has(self, _image: Image, _content: str) -> bool:
        return False

    def build(self, image: Image, _folder: Path, _content: str) -> None:
        if image.name == "broken":
            raise BuildError("It is broken.")
        self.barrier.wait()
        self.built.append(image.name)

    def save(self, _image: Image, archive: Path) -> None:
        archive.write_text("archive")


def test_images_are_built_beside_each_other(image: Image) -> None:
    engine: Any = Sequencer(together=2)
    both = [dataclasses.replace(image, name=name) for name in ("one", "two")]
    (context.cache() / "images").mkdir(parents=True)
    build.ensure_all(engine, both, archives=True)
    assert sorted(engine.built) == ["one", "two"]
    assert all(len(build.recorded(each)) == 64 for each in both)
    build.ensure_all(engines.Buildah.__new__(NeverBuilds), both, archives=True)


class NeverBuilds(engines.Buildah):
    """Knows the base, and fails where anything is to be built."""

    def base(self) -> str:
        return "base"

    def build(self, image: Image, folder: Path, content: str) -> None:
        raise AssertionError(f"{image.name} is there already, with {content}: {folder}")


def test_an_image_that_can_t_be_built_ends_the_others_in_peace(image: Image) -> None:
    engine: Any = Sequencer(together=1)
    some = [dataclasses.replace(image, name=name) for name in ("broken", "whole")]
    (context.cache() / "images").mkdir(parents=True)
    with pytest.raises(BuildError, match=r"It is broken\."):
        build.ensure_all(engine, some, archives=True)
    assert build.recorded(some[0]) == ""
    assert len(build.recorded(some[1])) == (64 if engine.built else 0)


def test_an_interrupt_begins_nothing_more(image: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(engines, "interrupted", threading.Event())
    monkeypatch.setattr(build, "wait", interrupt)
    (context.cache() / "images").mkdir(parents=True)
    engine: Any = Sequencer(together=1)
    with pytest.raises(KeyboardInterrupt):
        build.ensure_all(engine, [image], archives=True)
    with pytest.raises(BuildError, match="interrupted"):
        engines.run(["true"], log=context.cache() / "log")
    # A pull that the interrupt ended is no registry that does not answer.
    with pytest.raises(BuildError, match="interrupted"):
        engines.pulled(["true"])


def test_what_is_made_of_nothing_needs_no_base(image: Image) -> None:
    engine: Any = Sequencer(together=1)
    engine.base = None
    (context.cache() / "images").mkdir(parents=True)
    build.ensure_all(engine, [dataclasses.replace(image, base="scratch")], archives=True)
    assert engine.built == ["probe"]


def test_every_dockerfile_starts_from_the_pinned_base() -> None:
    for image in IMAGES:
        lines = image.dockerfile.read_text().splitlines()
        starts = [line.split()[1:] for line in lines if line.startswith("FROM ")]
        assert starts
        # Or from a stage before it.
        known = {context.BASE, "scratch"}
        for base, *named in starts:
            assert base in known
            known.update(named[1:])


def test_finds_mounts_below_a_folder_and_no_neighbours() -> None:
    text = (
        "45 27 0:39 / /c/tmp/mmdebstrap.a/dev/pts rw - devpts none rw\n"
        "46 27 0:22 / /c/tmp/mmdebstrap.a/sys ro - sysfs sys rw\n"
        "47 27 0:22 / /c/tmp/mmdebstrap.ab/sys ro - sysfs sys rw\n"
    )
    found = engines.mounts_below(text, Path("/c/tmp/mmdebstrap.a"))
    assert found == [Path("/c/tmp/mmdebstrap.a/dev/pts"), Path("/c/tmp/mmdebstrap.a/sys")]


def test_never_deletes_into_a_mount(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sys").mkdir()
    (tmp_path / "sys" / "precious").write_text("x")
    mounted = [tmp_path / "sys"]
    monkeypatch.setattr(engines, "mounts_below", lambda *_: mounted)
    with pytest.raises(BuildError, match="unmount"):
        engines.remove_tree(tmp_path)
    assert (tmp_path / "sys" / "precious").read_text() == "x"
    mounted.clear()
    engines.remove_tree(tmp_path)
    assert not tmp_path.exists()


def test_the_same_sources_give_the_same_wheel(tmp_path: Path) -> None:
    # Side by side, as two checkouts that share the cache may build it.
    with ThreadPoolExecutor(2) as pool:
        wheels = list(pool.map(context.memory_bag, [tmp_path / "one", tmp_path / "two"]))
    names = {wheel.name for wheel in wheels}
    assert names == {f"bagpipe_bag-{context.VERSION}-cp311-abi3-manylinux_2_34_x86_64.whl"}
    assert wheels[0].read_bytes() == wheels[1].read_bytes()
    with zipfile.ZipFile(wheels[0]) as wheel:
        held = {Path(name).name for name in wheel.namelist() if "dist-info" not in name}
    assert held == {"__init__.py", "__init__.pyi", "bagpipe_bag.abi3.so", "py.typed"}


class Checkout:
    """A workspace of one program, which prints a word."""

    def __init__(self, root: Path, word: str) -> None:
        self.root = root
        self.source = root / "images/agent/crates/a/src/main.rs"
        self.source.parent.mkdir(parents=True)
        package = '[package]\nname = "bagpipe-a"\nversion = "0.1.0"\nedition = "2024"\n'
        (self.source.parents[1] / "Cargo.toml").write_text(package)
        workspace = '[workspace]\nmembers = ["crates/a"]\nresolver = "3"\n'
        (root / "images/agent/Cargo.toml").write_text(workspace)
        self.source.write_text(f'fn main() {{ println!("{word}") }}\n')

    def printed(self, target: Path) -> tuple[str, bool]:
        """What the program prints that cargo leaves there, and whether it was compiled now."""
        built = subprocess.run(
            ["cargo", "build", "--offline"],
            cwd=self.root / "images/agent",
            env={**os.environ, "CARGO_TARGET_DIR": str(target)},
            capture_output=True, text=True, timeout=120, check=True,
        )  # fmt: skip
        program = [str(target / "debug/bagpipe-a")]
        word = subprocess.run(program, capture_output=True, text=True, timeout=60, check=True)
        return word.stdout.strip(), "Compiling" in built.stderr


def test_of_two_checkouts_that_share_a_cache_each_builds_its_own_sources(tmp_path: Path) -> None:
    target = tmp_path / "cargo"
    one, two = (Checkout(tmp_path / word, word) for word in ("one", "two"))
    # Older than all that is built, as the sources of a checkout are where another builds later.
    os.utime(two.source, (1, 1))
    for checkout, claimed in ((one, True), (one, False), (two, True), (one, True), (two, True)):
        assert claim.claim(target, checkout.root) == claimed
        assert checkout.printed(target) == (checkout.source.read_text().split('"')[1], claimed)


def test_a_claim_makes_nothing_old_that_was_built_elsewhere(tmp_path: Path) -> None:
    # The tests of a new clone were compiled twice: the images' folder was claimed meanwhile.
    first, second = tmp_path / "cargo-debug", tmp_path / "cargo"
    Checkout(tmp_path / "before", "before").printed(second)
    clone = Checkout(tmp_path / "clone", "clone")
    assert claim.claim(first, clone.root)
    assert clone.printed(first) == ("clone", True)
    assert claim.claim(second, clone.root)
    assert clone.printed(first) == ("clone", False)
    assert clone.printed(second) == ("clone", True)


def test_only_the_spark_image_gets_the_native_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def compiled(_what: str, command: list[str], _target: None) -> None:
        folder = Path(command[command.index("--out") + 1])
        (folder / "bagpipe_bag-1.whl").touch()

    monkeypatch.setenv("BAGPIPE_CACHE", str(tmp_path))
    monkeypatch.setattr(context, "compile_rust", compiled)
    monkeypatch.setattr(context, "requirements", lambda *_: None)
    staged = {i.name: context.stage(i) for i in IMAGES if i.name in {"operator", "spark"}}
    found = {name: {p.name for p in folder.rglob("*.whl")} for name, folder in staged.items()}
    ours = f"bagpipe-{context.VERSION}-py3-none-any.whl"
    assert found == {
        "operator": {ours, f"bagpipe_operator-{context.VERSION}-py3-none-any.whl"},
        "spark": {ours, "bagpipe_bag-1.whl"},
    }


def test_a_module_that_does_not_compile_is_reported_with_cargos_last_lines(tmp_path: Path) -> None:
    command = ["sh", "-c", "echo 'error: no such crate' >&2; exit 101"]
    with pytest.raises(BuildError, match=r"could not build it in images/agent.*\nerror: no such"):
        context.compile_rust("it", command)
    with pytest.raises(BuildError, match="maturin left 0 wheels"):
        context.one_wheel(tmp_path)


def test_a_lock_that_is_held_is_waited_for_and_then_reported(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "lock"
    refusal = pytest.raises(LockError, match=r"has held .*lock for too long")
    with locked(path), refusal, locked(path, seconds=0.0):
        pass
    with locked(path, seconds=0.0):
        assert path.exists()
