"""The wheel that a laptop installs has bagpipe, its native module and the agent."""

import base64
import hashlib
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from context import tool
from failure import BuildError
from whole_wheel import whole_wheel

TAGS = "cp311-abi3-manylinux_2_34_x86_64"


def wheel(path: Path, info: str, files: dict[str, str], tags: str) -> Path:
    purely = str(tags.endswith("any")).lower()
    described = f"Wheel-Version: 1.0\nRoot-Is-Purelib: {purely}\nTag: {tags}\n"
    metadata = f"Metadata-Version: 2.1\nName: {info.split('-', maxsplit=1)[0]}\nVersion: 0.1.0\n"
    with zipfile.ZipFile(path, "w") as opened:
        for name, text in files.items():
            opened.writestr(name, text)
        opened.writestr(f"{info}.dist-info/METADATA", metadata)
        opened.writestr(f"{info}.dist-info/WHEEL", described)
        opened.writestr(f"{info}.dist-info/RECORD", "")
    return path


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """Of small wheels and a script in place of the agent."""
    own = wheel(
        tmp_path / "bagpipe-0.1.0-py3-none-any.whl",
        "bagpipe-0.1.0",
        {"bagpipe/__init__.py": "import bagpipe_bag"},
        "py3-none-any",
    )
    native = wheel(
        tmp_path / f"bagpipe_bag-0.1.0-{TAGS}.whl",
        "bagpipe_bag-0.1.0",
        {"bagpipe_bag/__init__.py": "WORD = 'native'"},
        TAGS,
    )
    agent = tmp_path / "bagpipe-agent"
    agent.write_text("#!/bin/sh\necho played\n")
    return whole_wheel(own, native, agent, tmp_path)


def test_it_is_for_the_module_s_machines_and_its_record_is_true(made: Path) -> None:
    assert made.name == f"bagpipe-0.1.0-{TAGS}.whl"
    with zipfile.ZipFile(made) as opened:
        lines = opened.read("bagpipe-0.1.0.dist-info/RECORD").decode().splitlines()
        described = opened.read("bagpipe-0.1.0.dist-info/WHEEL").decode().splitlines()
        named = dict(line.split(",", 1) for line in lines)
        assert set(named) == set(opened.namelist())
        for name, rest in named.items():
            data = opened.read(name)
            digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            own = name.endswith("RECORD")
            assert rest == ("," if own else f"sha256={digest},{len(data)}")
    assert described == ["Wheel-Version: 1.0", "Root-Is-Purelib: false", f"Tag: {TAGS}"]


def test_installed_it_has_all_three(made: Path, tmp_path: Path) -> None:
    target = tmp_path / "installed"
    install = [tool("uv"), "pip", "install", "--quiet", "--offline", "--no-deps", "--no-cache"]
    command = [*install, "--python", sys.executable, "--target", str(target), str(made)]
    subprocess.run(command, check=True, timeout=60)
    code = "import bagpipe; print(bagpipe.bagpipe_bag.WORD)"
    asked = [sys.executable, "-c", code]
    environment = {"PYTHONPATH": str(target)}
    done = subprocess.run(
        asked, env=environment, capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == "native\n"
    agent = subprocess.run(
        [target / "bin" / "bagpipe-agent"], capture_output=True, text=True, check=True, timeout=60
    )
    assert agent.stdout == "played\n"


def test_the_same_files_give_the_same_bytes(made: Path, tmp_path: Path) -> None:
    (tmp_path / "again").mkdir()
    own = tmp_path / "bagpipe-0.1.0-py3-none-any.whl"
    native = tmp_path / f"bagpipe_bag-0.1.0-{TAGS}.whl"
    again = whole_wheel(own, native, tmp_path / "bagpipe-agent", tmp_path / "again")
    assert again.read_bytes() == made.read_bytes()


def test_what_is_no_wheel_of_that_name_is_refused(made: Path, tmp_path: Path) -> None:
    other = wheel(tmp_path / "bagpipe-0.2.0-py3-none-any.whl", "bagpipe-0.1.0", {}, "py3-none-any")
    with pytest.raises(BuildError, match=r"has no RECORD: it is no wheel of bagpipe 0\.2\.0"):
        whole_wheel(other, made, tmp_path / "bagpipe-agent", tmp_path)
