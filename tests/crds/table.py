"""jobs.yaml: jobs that the API server takes or refuses, each as a whole manifest."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

Manifest = dict[str, Any]

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Row:
    """`says` is a part of the refusal; empty for a job that is taken."""

    name: str
    manifest: Manifest
    says: str = ""

    def __str__(self) -> str:
        return self.name


def taken() -> list[Row]:
    """The good jobs and their variations."""
    table = _table()
    good = [Row(base, _good(table, base)) for base in table["good"]]
    return good + list(_changed(table, "taken"))


def refused() -> list[Row]:
    """Those that are refused, each with what the API server says."""
    return list(_changed(_table(), "refused"))


def _table() -> Manifest:
    # By libyaml: every process that collects tests reads it, and takes ten times as long in Python.
    text = Path(__file__).with_name("jobs.yaml").read_text()
    table: Manifest = yaml.load(text, Loader=yaml.CSafeLoader)
    return table


def _changed(table: Manifest, kind: str) -> Iterator[Row]:
    for base, rows in table[kind].items():
        for row in rows:
            manifest = _good(table, base)
            for path, value in row["with"].items():
                _put(manifest, path, value)
            says = row["says"] if kind == "refused" else ""
            yield Row(f"{base}: {row['case']}", manifest, says)


def _good(table: Manifest, base: str) -> Manifest:
    spec = table["good"][base]
    if isinstance(spec, str):
        spec = yaml.load((ROOT / spec).read_text(), Loader=yaml.CSafeLoader)["spec"]
    return {
        "apiVersion": "sim.bagpipe.io/v1alpha1",
        "kind": "SimulationJob",
        "metadata": {"name": "good"},
        "spec": copy.deepcopy(spec),
    }


def _put(manifest: Manifest, path: str, value: Any) -> None:
    *parents, last = path.split(".")
    place = manifest
    for name in parents:
        place = place.setdefault(name, {})
    if value is None:
        del place[last]
    else:
        place[last] = value
