"""Where what is in the images comes from: registries' files whose hashes are in the repository.

What is left is in docs/operations/threat-model.md: Debian's packages have apt's signatures.
"""

from __future__ import annotations

import re
import tomllib
import zipfile
from pathlib import Path

import context
import pytest
from context import IMAGES, ROOT

INSTALLS = re.compile(r"pip (?:install|wheel) ([^&|;\n]*)")
# The examples' images stand for a user's: their packages are pinned by version.
OURS = [image for image in IMAGES if image.name in {"agent", "operator", "spark", "ros"}]


@pytest.mark.parametrize("image", OURS, ids=lambda image: str(image.name))
def test_an_image_installs_nothing_without_its_hash(image: context.Image) -> None:
    text = image.dockerfile.read_text().replace("\\\n", " ")
    installs = INSTALLS.findall(text)
    assert len(installs) == {"operator": 2, "spark": 4}.get(image.name, 0)
    for words in installs:
        assert "--require-hashes" in words or "--no-index" in words, words
        # A source's own wishes for what builds it have no hashes.
        assert {"--only-binary", "--no-index", "--no-build-isolation"} & set(words.split()), words
    assert not re.search(r"curl|wget|\bADD\b|npm|cargo install|go install", text)


def test_every_requirement_has_a_hash(tmp_path: Path) -> None:
    files = {name: tmp_path / name for name in ("operator", "spark", "build")}
    context.requirements("bagpipe-operator", files["operator"])
    context.requirements("bagpipe", files["spark"], "spark", "storage")
    context.builders(files["build"])
    for name, least in (("operator", 30), ("spark", 30), ("build", 2)):
        text = files[name].read_text().replace("\\\n", " ")
        lines = [line for line in text.splitlines() if line and not line.lstrip().startswith("#")]
        assert len(lines) >= least
        assert all(re.search(r"==\S+ .*--hash=sha256:[0-9a-f]{64}", line) for line in lines)
    assert {"hatchling", "setuptools"} <= set(
        re.findall(r"^[a-z-]+", files["build"].read_text(), re.MULTILINE)
    )


def test_the_locks_know_the_hash_of_all_that_a_registry_gives() -> None:
    python = tomllib.loads((ROOT / "uv.lock").read_text())["package"]
    outside = [each for each in python if "registry" in each["source"]]
    assert {name for each in python for name in each["source"]} == {
        "registry",
        "editable",
        "virtual",
    }
    for each in outside:
        files = [*each.get("wheels", []), *([each["sdist"]] if "sdist" in each else [])]
        assert files
        assert all(file["hash"].startswith("sha256:") for file in files), each["name"]
    crates = tomllib.loads((ROOT / "images/agent/Cargo.lock").read_text())["package"]
    sources = {each["source"] for each in crates if "source" in each}
    assert sources == {"registry+https://github.com/rust-lang/crates.io-index"}
    assert all(len(each["checksum"]) == 64 for each in crates if "source" in each)


def test_a_wheel_of_ours_has_our_sources_and_nothing_else(tmp_path: Path) -> None:
    source = ROOT / "images/spark"
    context.package(source, tmp_path)
    (wheel,) = tmp_path.iterdir()
    with zipfile.ZipFile(wheel) as packed:
        info = f"bagpipe-{context.VERSION}.dist-info/"
        held = {name for name in packed.namelist() if not name.startswith(info)}
    inside = {
        str(p.relative_to(source / "src")) for p in (source / "src").rglob("*") if p.is_file()
    }
    assert held == {name for name in inside if "__pycache__" not in name}


def test_a_package_that_can_t_be_built_is_reported(tmp_path: Path) -> None:
    (tmp_path / "pyproject.toml").write_text("[project]\n")
    with pytest.raises(context.BuildError, match=f"hatchling could not build {tmp_path.name}: "):
        context.package(tmp_path, tmp_path / "wheels")
