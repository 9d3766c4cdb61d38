"""What tests build once: again for another state, after a failure, and by one process at a time."""

import fcntl
from pathlib import Path

import pytest

from tests.cached import made_once, state_of
from tests.waiting import NotSeenError


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("BAGPIPE_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


class Maker:
    """It fails so many times first."""

    def __init__(self, failures: int = 0) -> None:
        self.failures, self.calls = failures, 0

    def __call__(self, folder: Path) -> None:
        self.calls += 1
        folder.mkdir()
        (folder / "part").touch()
        if self.calls <= self.failures:
            raise OSError("no space left")


def test_each_state_is_made_once(cache: Path) -> None:
    maker = Maker()
    first = made_once("thing", b"1", maker)
    assert (made_once("thing", b"1", maker), maker.calls) == (first, 1)
    other = made_once("thing", b"2", maker)
    assert (other.parent, other != first, maker.calls) == (cache, True, 2)
    assert (other / "part").exists()


def test_what_failed_is_made_again_in_an_empty_place() -> None:
    maker = Maker(failures=1)
    with pytest.raises(OSError, match="no space left"):
        made_once("thing", b"1", maker)
    assert (made_once("thing", b"1", maker) / "part").exists()
    assert maker.calls == 2


def test_who_comes_while_another_makes_it_waits_and_no_longer_than_it_may(cache: Path) -> None:
    maker = Maker()
    cache.mkdir()
    with (cache / "thing.lock").open("w") as others:
        fcntl.flock(others, fcntl.LOCK_EX)
        with pytest.raises(NotSeenError, match=r"another process makes .*thing-"):
            made_once("thing", b"1", maker, wait_seconds=0.2)
    assert maker.calls == 0
    made_once("thing", b"1", maker, wait_seconds=0.2)
    assert maker.calls == 1


def test_a_state_is_of_names_and_contents(tmp_path: Path) -> None:
    first, second = tmp_path / "a", tmp_path / "b"
    first.write_bytes(b"x")
    second.write_bytes(b"y")
    both = state_of([first, second])
    assert both == state_of([second, first])
    first.write_bytes(b"y")
    second.write_bytes(b"x")
    assert state_of([first, second]) != both
    assert state_of([first]) != state_of([second.rename(tmp_path / "c")])
