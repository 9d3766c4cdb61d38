"""A job over MCAP: what the stack receives, and so what it answers, is what a bag gives it."""

import hashlib
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.integration.conftest import RunningAgent
from tests.integration.stacks import folders_with_recording, in_one_piece, over, run_all, stepped
from tests.mcap_of_bag import COMPRESSIONS, mcap_of
from tests.recording import MESSAGES

pytestmark = pytest.mark.integration


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    """The recording as a bag, and as MCAP in every compression, on one claim."""
    claims = folders_with_recording(tmp_path)
    bag = Path(claims["recordings"]) / "pr2/joint_states.bag"
    for compression in COMPRESSIONS:
        mcap_of(bag, bag.with_name(f"{compression}.mcap"), compression)
    return claims


def test_in_lock_step_the_answers_are_the_same_bytes_as_to_the_bag(
    folders: dict[str, str], start_agent: Callable[..., RunningAgent], tmp_path: Path
) -> None:
    (tmp_path / "files").mkdir()
    in_memory = start_agent()
    on_disk = start_agent(1, None, "--on-disk", str(tmp_path / "files"))
    digests = set()
    files = ["joint_states.bag", *(f"{compression}.mcap" for compression in COMPRESSIONS)]
    for file, agent in [*((file, in_memory) for file in files), ("zstd.mcap", on_disk)]:
        (row,) = run_all(over(in_one_piece(), file), folders, agent)
        assert (row["outcome"], row["attempts"]) == ("passed", 1), row
        ledger = row["result"]["ledger"]
        assert (ledger["sent"], ledger["received"], ledger["dropped"]) == (MESSAGES, MESSAGES, 0)
        recorded = Path(folders["results"]) / "r" / row["recorded"]
        digests.add(hashlib.sha256(recorded.read_bytes()).hexdigest())
    assert len(digests) == 1


def test_its_fragments_play_every_message_once(
    folders: dict[str, str], start_agent: Callable[..., RunningAgent]
) -> None:
    rows = run_all(over(stepped(), "lz4.mcap"), folders, start_agent())
    assert [row["outcome"] for row in rows] == ["passed"] * len(rows)
    assert len(rows) == 4
    assert sum(row["result"]["ledger"]["sent"] for row in rows) == MESSAGES


def test_damage_in_a_chunk_is_reported_with_its_place_in_the_file(
    folders: dict[str, str], start_agent: Callable[..., RunningAgent]
) -> None:
    path = Path(folders["recordings"]) / "pr2/zstd.mcap"
    data = bytearray(path.read_bytes())
    place = len(data) // 4
    data[place : place + 64] = bytes(64)
    path.write_bytes(data)
    (row,) = run_all(over(in_one_piece(), "zstd.mcap"), folders, start_agent())
    assert (row["outcome"], row["reason"]) == ("errored", "BagUnreadable")
    assert "zstd.mcap" in row["message"]
    assert "byte " in row["message"]
