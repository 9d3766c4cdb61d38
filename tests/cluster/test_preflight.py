"""What an installation leaves behind, and what room it asks for."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest
from embedded import preflight
from embedded.preflight import services_held


def test_no_service_is_started_by_an_installation(tmp_path: Path) -> None:
    policy = tmp_path / "policy-rc.d"
    with services_held(policy):
        assert policy.read_text().endswith("exit 101\n")
        assert os.access(policy, os.X_OK)
    assert not policy.exists()


def test_a_policy_of_the_machines_own_stays(tmp_path: Path) -> None:
    policy = tmp_path / "policy-rc.d"
    policy.write_text("#!/bin/sh\nexit 0\n")
    with services_held(policy):
        assert policy.read_text().endswith("exit 0\n")
    assert policy.exists()


def test_a_disk_has_room_for_what_is_still_to_be_built(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BAGPIPE_CACHE", str(tmp_path))
    disk = SimpleNamespace(free=0.0)
    monkeypatch.setattr("shutil.disk_usage", lambda _: disk)
    monkeypatch.setenv("MAKELEVEL", "1")
    found = []
    for images in range(3, 5):
        (tmp_path / "images").mkdir(exist_ok=True)
        for number in range(images):
            (tmp_path / "images" / f"{number}.oci.json").touch()
        for free in (15.0, 14.9, 4.0, 3.9):
            disk.free = free * 2**30
            found.append(preflight.disk(tmp_path) is None)
    assert found == [True, False, False, False, True, True, True, False]
    assert preflight.disk(tmp_path) == (
        f"{tmp_path} has 3.9 GiB free; 4 GiB are needed for images and caches."
    )
    monkeypatch.setenv("MAKELEVEL", "2")
    assert preflight.disk(tmp_path) is None


def test_who_waited_for_apt_asks_it_for_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BAGPIPE_CACHE", str(tmp_path))
    answers = [["make"], []]
    monkeypatch.setattr(preflight, "missing", lambda _: answers.pop(0))
    monkeypatch.setattr(preflight, "apt", lambda *_: pytest.fail("asked"))
    preflight.install(["make"])
    assert answers == []
