"""The life of one fuzzed object: written, edited, given what somebody forged, and deleted."""

import contextlib
import random
from dataclasses import dataclass

from embedded.api import ApiError

from tests.fuzz.manifests import forged
from tests.fuzz.manifests.generator import JOB, Generator, Manifest
from tests.fuzz.manifests.tally import Tally
from tests.fuzz.manifests.values import Json
from tests.integration.control_plane.client import JOBS as BASE
from tests.integration.control_plane.client import JSON, MERGE_PATCH, Client, core

PLURALS = {JOB: "simulationjobs", "SimulationSchedule": "simulationschedules"}
# How often each thing happens to an object that was accepted.
_EDITED, _FORGED_STATUS, _FORGED_POD, _FORGED_CONFIG, _DELETED = 0.25, 0.25, 0.12, 0.06, 0.12


class OddAnswerError(AssertionError):
    """The API server answered with a fault of its own."""


@dataclass
class Case:
    """One manifest and what follows; all of it is chosen by `seed` and by nothing else."""

    client: Client
    namespace: str
    name: str
    manifest: Manifest
    seed: str
    lax: bool
    tally: Tally

    def live(self) -> None:
        """Writes the object, and where it was accepted does what its chance says."""
        rng = random.Random(self.seed)
        generator = Generator(rng, self.lax)
        phase = "any-crd" if self.lax else "crd"
        meta = self.manifest.object["metadata"]
        meta["name"] = self.name if meta["name"].startswith("f") else meta["name"]
        made = self._try("POST", self._path(), self.manifest.object)
        for count in ("written", f"{phase} written"):
            self.tally.add(count)
        if made is None:
            self.tally.add("refused")
            return
        for count in ("accepted", f"{phase} accepted"):
            self.tally.add(count)
        kept = made["metadata"]
        # What holds an object would keep it beyond its batch.
        if kept.get("finalizers"):
            self._try("PATCH", self._path(kept["name"]), {"metadata": {"finalizers": None}})
        self._happen(rng, generator, made)

    def _happen(self, rng: random.Random, generator: Generator, made: Json) -> None:
        name, uid, kind = made["metadata"]["name"], made["metadata"]["uid"], self.manifest.kind
        if rng.random() < _FORGED_STATUS:
            status = {"status": generator.status(kind)}
            self._count("statuses", "PATCH", self._path(name) + "/status", status)
        if rng.random() < _FORGED_POD and kind == JOB:
            self._forge_pod(rng, forged.pod(rng, name, uid))
        if rng.random() < _FORGED_CONFIG and kind == JOB:
            config = forged.config_map(rng, name, uid)
            self._count("config maps", "POST", core(self.namespace, "configmaps"), config)
        if rng.random() < _EDITED:
            edited = generator.edit(kind, made)
            edited["metadata"].pop("resourceVersion", None)
            spec = edited.get("spec")
            self._count("edits", "PATCH", self._path(name), {"spec": spec})
        if rng.random() < _DELETED:
            self._try("DELETE", self._path(name), None)
            self.tally.add("deletes")

    def _forge_pod(self, rng: random.Random, pod: Json) -> None:
        made = self._count("pods", "POST", core(self.namespace, "pods"), pod)
        if made is not None:
            path = core(self.namespace, "pods", made["metadata"]["name"])
            status = {"status": forged.pod_status(rng)}
            self._count("pod statuses", "PATCH", path + "/status", status)

    def _count(self, what: str, method: str, path: str, body: Json) -> Json:
        done = self._try(method, path, body)
        self.tally.add(f"{what} refused" if done is None else what)
        return done

    def _path(self, name: str = "") -> str:
        plural = PLURALS[self.manifest.kind]
        below = f"{BASE}/namespaces/{self.namespace}/{plural}"
        return f"{below}/{name}" if name else below

    def _try(self, method: str, path: str, body: Json) -> Json:
        """The answer; None where the API server refused."""
        return attempt(self.client, self.tally, method, path, body)


def attempt(client: Client, tally: Tally, method: str, path: str, body: Json) -> Json:
    """One call; None where it was refused for what it says (4xx). Other faults are counted."""
    type_ = MERGE_PATCH if method == "PATCH" else JSON
    with contextlib.suppress(ApiError):
        try:
            return client.call(method, path, body, type_)
        except ApiError as error:
            if error.status >= 500:
                tally.add("odd answers")
                tally.add(f"odd: {error.status} {str(error)[:160]}")
            raise
    return None
