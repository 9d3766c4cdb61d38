"""The C++ header and the Rust crate: the checks that the Python SDK passes, compiled here."""

import subprocess
from pathlib import Path

import pytest

from bagpipe.binpiped.logic import Command
from tests.binpipe_conformance import CHECKS, Check
from tests.integration.binpipe.conftest import EXAMPLES, ROOT, cargo_example


@pytest.fixture(scope="module")
def repeat_cpp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    program = tmp_path_factory.mktemp("cpp") / "repeat"
    strict = ["-std=c++17", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    sources = ["-I", str(ROOT / "images/spark/sdk/cpp"), str(EXAMPLES / "repeat.cpp")]
    subprocess.run(["g++", *strict, *sources, "-o", str(program)], check=True, timeout=300)
    return program


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_cpp_sdk(check: Check, repeat_cpp: Path) -> None:
    check(Command((str(repeat_cpp),)))


@pytest.fixture(scope="module")
def repeat_rust() -> Path:
    return cargo_example("repeat")


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_rust_sdk(check: Check, repeat_rust: Path) -> None:
    check(Command((str(repeat_rust),)))
