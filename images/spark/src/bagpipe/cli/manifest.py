"""Manifests from files: which object is the job, and what is wrong with it, in the user's words."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from bagpipe.marks import marks_of
from bagpipe.spec import SimulationJobSpec
from bagpipe.spec_faults import sentence

API_GROUP = "sim.bagpipe.io/"
_LARGEST_BYTES = 4 << 20
_MOST_KINDS = 5


class _Loader(yaml.SafeLoader):
    """YAML as kubectl reads it: what looks like a day is a text."""


_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in found if tag != "tag:yaml.org,2002:timestamp"]
    for first, found in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


class ManifestError(ValueError):
    """No job can be read from a file; the sentence says which file, where, and what to write."""


def read_job(path: Path) -> tuple[str, SimulationJobSpec]:
    """The name and the spec of the one SimulationJob in a YAML or JSON file.

    Raises ManifestError.
    """
    job, _ = _only_job(path)
    name = str(_metadata(path, job).get("name") or "")
    if not name:
        raise ManifestError(f"{path}: metadata.name is missing: give the job a name")
    try:
        return name, SimulationJobSpec.model_validate(job.get("spec") or {})
    except ValidationError as error:
        raise ManifestError("\n".join(_sentences(path, error))) from error


def read_marks(path: Path) -> dict[str, dict[str, str]]:
    """The `labels` and `annotations` of the one SimulationJob in a file, as results keep them.

    Raises ManifestError.
    """
    metadata = _metadata(path, _only_job(path)[0])
    return marks_of(metadata.get("labels") or {}, metadata.get("annotations") or {})


def read_object(path: Path) -> tuple[dict[str, Any], int]:
    """The one SimulationJob of a file as it is written, and how many other objects there are.

    `-` is stdin. Nothing but its kind is judged: that is the API server's task. Raises
    ManifestError.
    """
    job, others = _only_job(path)
    return dict(job) | {"metadata": _metadata(path, job)}, others


def _metadata(path: Path, job: Mapping[str, Any]) -> dict[str, Any]:
    metadata = job.get("metadata") or {}
    if not isinstance(metadata, dict):
        raise ManifestError(f"{path}: metadata is no map: write metadata: {{name: my-job}}")
    return dict(metadata)


def _only_job(path: Path) -> tuple[Mapping[str, Any], int]:
    found = _objects(path)
    jobs = [each for each in found if each.get("kind") == "SimulationJob"]
    if len(jobs) != 1:
        kinds = dict.fromkeys(str(each.get("kind") or "what has no kind") for each in found)
        there = f", but {' and '.join(list(kinds)[:_MOST_KINDS])}" if kinds and not jobs else ""
        raise ManifestError(f"{path} holds {len(jobs)} SimulationJobs{there}: it must hold one")
    version = str(jobs[0].get("apiVersion", ""))
    if not version.startswith(API_GROUP):
        raise ManifestError(f"{path}: apiVersion is {version!r}: write {API_GROUP}v1alpha1")
    return jobs[0], len(found) - 1


def _objects(path: Path) -> list[Mapping[str, Any]]:
    try:
        found = list(yaml.load_all(_text(path), _Loader))
    except OSError as error:
        raise ManifestError(f"{path} can't be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ManifestError(f"{path} is no text (byte {error.start})") from error
    except yaml.YAMLError as error:
        raise ManifestError(f"{path} is no YAML: {error}") from error
    return [each for each in found if isinstance(each, dict)]


def _text(path: Path) -> str:
    if str(path) == "-":
        text = sys.stdin.buffer.read(_LARGEST_BYTES + 1)
    else:
        with path.open("rb") as file:
            text = file.read(_LARGEST_BYTES + 1)
    if len(text) > _LARGEST_BYTES:
        raise ManifestError(f"{path} is larger than 4 MiB, which is no manifest")
    return text.decode()


def _sentences(path: Path, error: ValidationError) -> list[str]:
    """One line per fault, with the field as it stands in the manifest."""
    faults = error.errors(include_url=False, include_input=False)
    return [f"{path}: {sentence(fault['loc'], fault['msg'])}" for fault in faults]
