"""JSON Schemas of SimulationJobs and SimulationSchedules, for editors: made of the CRDs.

They know fields, their types and bounds. Rules over several fields are CEL, which JSON Schema can't
express: `bagpipe submit --dry-run` asks the API server about those.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml

from release.version import ROOT

Schema = dict[str, Any]
KINDS = {"simulationjob": "simulationjobs.yaml", "simulationschedule": "simulationschedules.yaml"}


def closed(schema: Schema) -> Schema:
    """A structural schema of Kubernetes as JSON Schema, in which an unknown field is a fault."""
    kept = {key: value for key, value in schema.items() if not key.startswith("x-kubernetes-")}
    if isinstance(kept.get("items"), dict):
        kept["items"] = closed(kept["items"])
    if isinstance(kept.get("additionalProperties"), dict):
        kept["additionalProperties"] = closed(kept["additionalProperties"])
    if "properties" in kept:
        kept["properties"] = {key: closed(value) for key, value in kept["properties"].items()}
        if not schema.get("x-kubernetes-preserve-unknown-fields"):
            kept.setdefault("additionalProperties", False)
    if schema.get("x-kubernetes-int-or-string"):
        kept["type"] = ["integer", "string"]
    for bound in ("Minimum", "Maximum"):
        # OpenAPI 3.0 has a flag there beside the bound, and JSON Schema the bound itself.
        if kept.pop(f"exclusive{bound}", False):
            kept[f"exclusive{bound}"] = kept.pop(bound.lower())
    return kept


def schema_of(crd: Schema) -> Schema:
    """The schema of a CRD's one version, for a whole manifest."""
    group, kind = crd["spec"]["group"], crd["spec"]["names"]["kind"]
    version = crd["spec"]["versions"][0]
    schema = closed(version["schema"]["openAPIV3Schema"])
    properties = schema["properties"]
    properties["apiVersion"] |= {"const": f"{group}/{version['name']}"}
    properties["kind"] |= {"const": kind}
    # Its fields are Kubernetes' own, which the CRD leaves to the API server.
    properties["metadata"] = {"type": "object", "description": "Name, namespace and labels."}
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": kind,
        **schema,
        "required": sorted({*schema.get("required", []), "apiVersion", "kind", "metadata", "spec"}),
    }


def write(folder: Path) -> list[Path]:
    """Write a schema for each kind into a folder; their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, file in KINDS.items():
        crd = yaml.safe_load((ROOT / "crds" / file).read_text())
        path = folder / f"{name}-{crd['spec']['versions'][0]['name']}.json"
        path.write_text(json.dumps(schema_of(crd), indent=1) + "\n")
        written.append(path)
    return written
