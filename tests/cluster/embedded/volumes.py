"""The default StorageClass `local`: a folder of the machine for each claim.

All nodes are this one machine, so a folder can be offered to all of them, and is, to a claim
that asks for ReadWriteMany or ReadOnlyMany. A claim for ReadWriteOnce gets a volume of the node
that its first pod was sent to, as it would from a class of local disks.

A daemon of ours makes a PersistentVolume for each claim of the class that a pod waits for, and
removes the folder and the volume once the claim is gone. It looks at everything once a second
and acts on what it sees; one thread does it all and every name follows from the claim's UID, so
an interruption anywhere is made good by the next look.
"""

from __future__ import annotations

import shutil
import sys
import threading
from dataclasses import dataclass
from pathlib import Path

from .api import Api, ApiError, Object
from .places import VOLUMES

CLASS = "local"
PROVISIONER = "bagpipe.io/local"
LOOK_SECONDS = 1.0
COLLECTION = "/api/v1/persistentvolumes"
SHARED_MODES = {"ReadWriteMany", "ReadOnlyMany"}
SELECTED_NODE = "volume.kubernetes.io/selected-node"


def storage_class() -> Object:
    return {
        "apiVersion": "storage.k8s.io/v1",
        "kind": "StorageClass",
        "metadata": {
            "name": CLASS,
            "annotations": {"storageclass.kubernetes.io/is-default-class": "true"},
        },
        "provisioner": PROVISIONER,
        "reclaimPolicy": "Delete",
        # A volume for one node belongs to it, so the scheduler's choice has to come first.
        "volumeBindingMode": "WaitForFirstConsumer",
    }


def volume_for(claim: Object) -> Object:
    """The volume of a claim. hostPath knows no quota: the size is the claim's word only."""
    meta, spec = claim["metadata"], claim["spec"]
    name = f"pvc-{meta['uid']}"
    return {
        "apiVersion": "v1",
        "kind": "PersistentVolume",
        "metadata": {
            "name": name,
            "annotations": {"pv.kubernetes.io/provisioned-by": PROVISIONER},
        },
        "spec": {
            "storageClassName": CLASS,
            "capacity": {"storage": spec["resources"]["requests"]["storage"]},
            "accessModes": spec["accessModes"],
            "volumeMode": "Filesystem",
            "persistentVolumeReclaimPolicy": "Delete",
            "hostPath": {"path": str(VOLUMES / name), "type": "Directory"},
            **affinity(spec["accessModes"], meta["annotations"][SELECTED_NODE]),
            "claimRef": {
                "apiVersion": "v1",
                "kind": "PersistentVolumeClaim",
                "namespace": meta["namespace"],
                "name": meta["name"],
                "uid": meta["uid"],
            },
        },
    }


def affinity(modes: list[str], node: str) -> Object:
    """Where a volume of these access modes can be had: on its node, or anywhere."""
    if SHARED_MODES & set(modes):
        return {}
    hostname = {"key": "kubernetes.io/hostname", "operator": "In", "values": [node]}
    return {"nodeAffinity": {"required": {"nodeSelectorTerms": [{"matchExpressions": [hostname]}]}}}


def wanted(claim: Object) -> bool:
    """Whether a claim waits for a volume of ours, on a node that has been chosen."""
    return (
        claim["spec"].get("storageClassName") == CLASS
        and not claim["spec"].get("volumeName")
        and claim["spec"].get("volumeMode", "Filesystem") == "Filesystem"
        and SELECTED_NODE in claim["metadata"].get("annotations", {})
        and "deletionTimestamp" not in claim["metadata"]
    )


@dataclass(frozen=True)
class Plan:
    """What one look decides."""

    create: list[Object]
    delete: list[str]
    folders: list[str]


def plan(claims: list[Object], volumes: list[Object], folders: list[str]) -> Plan:
    """Volumes to create, volumes to delete with their folders, and folders that nobody has.

    A released volume is one whose claim is gone; the controller manager says so in its phase
    after making sure that no pod uses the claim any more.
    """
    ours = {
        v["metadata"]["name"]: v
        for v in volumes
        if v["metadata"].get("annotations", {}).get("pv.kubernetes.io/provisioned-by")
        == PROVISIONER
    }
    create = [
        volume_for(c) for c in claims if wanted(c) and f"pvc-{c['metadata']['uid']}" not in ours
    ]
    delete = [
        name
        for name, volume in ours.items()
        if volume.get("status", {}).get("phase") == "Released"
        and volume["spec"]["persistentVolumeReclaimPolicy"] == "Delete"
    ]
    kept = set(ours) | {v["metadata"]["name"] for v in create}
    return Plan(create, delete, [f for f in folders if f not in kept])


def look(api: Api, root: Path) -> None:
    """Look once and do what the plan says, in an order in which every stop is harmless."""
    claims = api.call("GET", "/api/v1/persistentvolumeclaims")["items"]
    volumes = api.call("GET", COLLECTION)["items"]
    decided = plan(claims, volumes, [p.name for p in root.iterdir()])
    for volume in decided.create:
        folder = Path(volume["spec"]["hostPath"]["path"])
        folder.mkdir(parents=True, exist_ok=True)
        folder.chmod(0o777)  # pods run as any user, and hostPath gives a folder to none of them
        api.create(COLLECTION, volume)
        print(f"made {folder.name}", flush=True)
    for name in decided.delete:
        shutil.rmtree(root / name, ignore_errors=True)
        api.call("DELETE", f"{COLLECTION}/{name}")
        print(f"removed {name}", flush=True)
    for name in decided.folders:
        shutil.rmtree(root / name, ignore_errors=True)


def main() -> None:
    """Look until killed. An unreachable API server is a reason to look again, not to end."""
    VOLUMES.mkdir(parents=True, exist_ok=True)
    api, pause = Api(), threading.Event()
    while True:
        try:
            look(api, VOLUMES)
        except (OSError, ApiError) as error:
            print(error, file=sys.stderr, flush=True)
        pause.wait(LOOK_SECONDS)


if __name__ == "__main__":
    main()
