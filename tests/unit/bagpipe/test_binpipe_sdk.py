"""The Python SDK: the checks of every SDK, its own MessagePack and checksums beside others'."""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import google_crc32c
import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe.binpipe.frames import BinpipeError, Incoming, slow_crc
from bagpipe.binpipe.maps import pack, unpack
from bagpipe.binpiped.logic import Command
from tests.binpipe_conformance import CHECKS, Check, record, run

ROOT = Path(__file__).parents[3]
REPEAT = ROOT / "docs/examples/binpipe/repeat.py"
VECTORS = json.loads((ROOT / "docs/reference/binpipe-vectors.json").read_text())


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_python_sdk(check: Check) -> None:
    path = os.pathsep.join(sys.path)
    check(Command((sys.executable, str(REPEAT)), (("PYTHONPATH", path),)))


def test_the_sdk_runs_alone_without_any_package(tmp_path: Path) -> None:
    (tmp_path / "bagpipe").mkdir()
    (tmp_path / "bagpipe/binpipe").symlink_to(ROOT / "images/spark/src/bagpipe/binpipe")
    # -I and -S: neither the environment's packages nor the machine's are there.
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); exec({REPEAT.read_text()!r})"
    (got,) = run(Command((sys.executable, "-I", "-S", "-c", code)), [record("a", b"data" * 1000)])
    assert got.data == b"data" * 1000


def test_importing_the_sdk_loads_neither_spark_nor_pydantic() -> None:
    code = "import sys, bagpipe.binpipe; print({'pyspark', 'pydantic'} & set(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "set()\n"


VALUES: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.text() | st.binary(),
    lambda inner: st.dictionaries(st.text(), inner, max_size=20),
    max_leaves=30,
)


@given(fields=st.dictionaries(st.text(), VALUES, max_size=20))
def test_maps_are_those_of_the_msgpack_library(fields: dict[str, Any]) -> None:
    assert pack(fields) == msgpack.packb(fields)
    assert unpack(msgpack.packb(fields)) == fields


@given(data=st.binary(max_size=200))
def test_no_bytes_make_the_map_reader_fail_otherwise_than_by_its_own_error(data: bytes) -> None:
    with contextlib.suppress(BinpipeError):
        unpack(data)


@given(data=st.binary(max_size=300), more=st.binary(max_size=50))
def test_the_checksum_without_a_library_is_the_same(data: bytes, more: bytes) -> None:
    assert slow_crc(slow_crc(0, data), more) == google_crc32c.value(data + more)


@pytest.mark.parametrize("vector", VECTORS, ids=[vector["name"] for vector in VECTORS])
def test_the_sdk_reads_the_shared_vectors(vector: dict[str, Any]) -> None:
    read, write = os.pipe()
    stream = bytes.fromhex(vector["hex"])
    # A pipe takes 64 KiB without a reader; the vectors are smaller.
    assert os.write(write, stream) == len(stream)
    os.close(write)
    incoming = Incoming(read, lambda: None)
    expected = [(f["type"], bytes.fromhex(f["payload_hex"])) for f in vector.get("frames", [])]
    names = ["", "HELLO", "FILE", "DATA", "RESULT", "METRIC", "END", "ABORT"]
    try:
        # A program never takes turns with a simulator: these types are none for it.
        foreign = any(frame[0] in {"STEP", "ANSWER"} for frame in expected)
        if "error" in vector or foreign:
            with pytest.raises(BinpipeError):
                while incoming.next() is not None:
                    pass
        else:
            got = []
            while (frame := incoming.next()) is not None:
                got.append((names[frame[0]], frame[1]))
            assert got == expected
    finally:
        os.close(read)
