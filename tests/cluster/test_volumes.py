"""One look of the provisioner: what it makes, what it removes, what it leaves alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from embedded import volumes
from embedded.volumes import plan

Object = dict[str, Any]


def claim(uid: str, **changes: Any) -> Object:
    spec = {
        "storageClassName": "local",
        "accessModes": ["ReadWriteOnce"],
        "resources": {"requests": {"storage": "1Gi"}},
    }
    annotations = {volumes.SELECTED_NODE: "bagpipe-0"}
    metadata = {"uid": uid, "name": "data", "namespace": "default", "annotations": annotations}
    return {"metadata": metadata | changes.pop("metadata", {}), "spec": spec | changes}


def volume(uid: str, phase: str, provisioner: str = volumes.PROVISIONER) -> Object:
    made = volumes.volume_for(claim(uid))
    made["metadata"]["annotations"] = {"pv.kubernetes.io/provisioned-by": provisioner}
    return made | {"status": {"phase": phase}}


class FakeApi:
    """An API server with claims and volumes that records its requests."""

    def __init__(self, claims: list[Object], found: list[Object]) -> None:
        self.claims, self.found = claims, found
        self.calls: list[str] = []

    def call(self, method: str, path: str) -> Object:
        self.calls.append(f"{method} {path}")
        return {"items": self.claims if path.endswith("claims") else self.found}

    def create(self, path: str, body: Object) -> None:
        self.calls.append(f"POST {path} {body['metadata']['name']}")


def test_makes_a_volume_for_a_claim_with_a_node() -> None:
    decided = plan([claim("u1")], [], [])
    assert [v["metadata"]["name"] for v in decided.create] == ["pvc-u1"]
    made = decided.create[0]["spec"]
    assert made["hostPath"]["path"] == "/var/lib/bagpipe/volumes/pvc-u1"
    assert made["claimRef"]["uid"] == "u1"
    assert made["capacity"] == {"storage": "1Gi"}
    term = made["nodeAffinity"]["required"]["nodeSelectorTerms"][0]["matchExpressions"][0]
    assert term["values"] == ["bagpipe-0"]


@pytest.mark.parametrize(
    ("modes", "anywhere"),
    [
        (["ReadWriteOnce"], False),
        (["ReadWriteOncePod"], False),
        (["ReadWriteMany"], True),
        (["ReadOnlyMany"], True),
        (["ReadWriteOnce", "ReadWriteMany"], True),
    ],
)
def test_a_volume_for_many_is_bound_to_no_node(modes: list[str], anywhere: bool) -> None:
    (made,) = plan([claim("u1", accessModes=modes)], [], []).create
    assert ("nodeAffinity" not in made["spec"]) == anywhere
    assert made["spec"]["accessModes"] == modes


@pytest.mark.parametrize(
    "other",
    [
        claim("u1", storageClassName="other"),
        claim("u1", volumeName="pv-7"),
        claim("u1", volumeMode="Block"),
        claim("u1", metadata={"annotations": {}}),
        claim("u1", metadata={"deletionTimestamp": "2026-11-20T00:00:00Z"}),
    ],
)
def test_leaves_other_claims_alone(other: Object) -> None:
    assert plan([other], [], []).create == []


def test_makes_no_second_volume() -> None:
    decided = plan([claim("u1")], [volume("u1", "Available")], ["pvc-u1"])
    assert (decided.create, decided.delete, decided.folders) == ([], [], [])


def test_removes_only_released_volumes_of_its_own() -> None:
    found = [volume("u1", "Released"), volume("u2", "Bound"), volume("u3", "Released", "other")]
    decided = plan([], found, ["pvc-u1", "pvc-u2"])
    assert decided.delete == ["pvc-u1"]
    assert decided.folders == []


def test_keeps_a_volume_that_is_to_be_retained() -> None:
    kept = volume("u1", "Released")
    kept["spec"]["persistentVolumeReclaimPolicy"] = "Retain"
    decided = plan([], [kept], ["pvc-u1"])
    assert (decided.delete, decided.folders) == ([], [])


def test_removes_a_folder_that_an_interruption_left() -> None:
    assert plan([], [volume("u2", "Bound")], ["pvc-u1", "pvc-u2"]).folders == ["pvc-u1"]


def test_a_look_makes_the_folder_first_and_for_everyone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(volumes, "VOLUMES", tmp_path)
    api = FakeApi([claim("u1")], [])
    volumes.look(api, tmp_path)  # type: ignore[arg-type]
    assert (tmp_path / "pvc-u1").stat().st_mode & 0o777 == 0o777
    assert api.calls[-1] == "POST /api/v1/persistentvolumes pvc-u1"


def test_a_look_removes_the_data_before_the_volume(tmp_path: Path) -> None:
    (tmp_path / "pvc-u1").mkdir()
    (tmp_path / "pvc-u1" / "data").write_text("x")
    api = FakeApi([], [volume("u1", "Released")])
    volumes.look(api, tmp_path)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []
    assert api.calls[-1] == "DELETE /api/v1/persistentvolumes/pvc-u1"
