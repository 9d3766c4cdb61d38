"""The charts as packages: pinned images, what Artifact Hub reads, and the same bytes twice."""

from __future__ import annotations

import subprocess
import tarfile
from pathlib import Path
from typing import Any

import pytest
import yaml

from release import ReleaseError, changelog, charts, version

ROOT = Path(__file__).parents[3]
NUMBER = version.version()
DIGESTS = {
    name: f"sha256:{letter * 64}"
    for name, letter in (("agent", "a"), ("operator", "b"), ("spark", "c"))
}


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("charts")
    return charts.pack("bagpipe", NUMBER, folder, "registry.example/robots", DIGESTS)


def held(package: Path, name: str) -> str:
    with tarfile.open(package) as tar:
        file = tar.extractfile(name)
        assert file is not None
        return file.read().decode()


def helm(*words: str) -> str:
    done = subprocess.run(["helm", *words], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_helm_renders_the_images_by_their_digests(package: Path) -> None:
    rendered = helm(
        "template", "bagpipe", str(package), "--set", "jobNamespaces={robots}",
        "--namespace", "bagpipe-system", "--kube-version", "1.34",
    )  # fmt: skip
    for name, digest in DIGESTS.items():
        assert f"registry.example/robots/{name}@{digest}" in rendered
    assert "bagpipe.local/" not in rendered


def test_the_values_are_the_checkout_s_but_for_registry_and_digests(package: Path) -> None:
    ours = (ROOT / "charts/bagpipe/values.yaml").read_text().splitlines()
    theirs = held(package, "bagpipe/values.yaml").splitlines()
    changed = [new for old, new in zip(ours, theirs, strict=True) if old != new]
    assert changed == [
        "  registry: registry.example/robots",
        *(f"    {name}: {DIGESTS[name]}" for name in ("operator", "spark", "agent")),
    ]


def test_artifact_hub_finds_what_it_shows(package: Path) -> None:
    chart = yaml.safe_load(helm("show", "chart", str(package)))
    assert (chart["name"], chart["version"], chart["appVersion"]) == ("bagpipe", NUMBER, NUMBER)
    notes: dict[str, Any] = {
        key.removeprefix("artifacthub.io/"): yaml.safe_load(value)
        for key, value in chart["annotations"].items()
    }
    assert (notes["license"], notes["operator"], notes["prerelease"]) == ("Apache-2.0", True, False)
    assert [each["image"] for each in notes["images"]] == [
        f"registry.example/robots/{name}@{DIGESTS[name]}" for name in sorted(DIGESTS)
    ]
    assert [each["kind"] for each in notes["crds"]] == ["SimulationJob", "SimulationSchedule"]
    assert [each["kind"] for each in notes["crdsExamples"]] == [
        "SimulationJob",
        "SimulationSchedule",
    ]
    assert all(isinstance(each, str) for each in notes["changes"])
    assert notes["changes"] == changelog.changes(NUMBER)


def test_the_package_has_no_tests_of_its_own_and_a_page(package: Path) -> None:
    with tarfile.open(package) as tar:
        names = set(tar.getnames())
    assert not [name for name in names if name.startswith("bagpipe/tests/")]
    assert {"bagpipe/templates/tests/acceptance.yaml", "bagpipe/LICENSE"} <= names
    assert "oci://" in helm("show", "readme", str(package))


def test_the_same_sources_give_the_same_bytes(package: Path, tmp_path: Path) -> None:
    again = charts.pack("bagpipe", NUMBER, tmp_path, "registry.example/robots", DIGESTS)
    assert again.read_bytes() == package.read_bytes()


def test_the_namespace_s_chart_is_a_package_too(tmp_path: Path) -> None:
    package = charts.pack("bagpipe-namespace", NUMBER, tmp_path)
    assert yaml.safe_load(helm("show", "chart", str(package)))["version"] == NUMBER


def test_a_prerelease_is_called_one() -> None:
    found = charts.hub_annotations({}, "1.0.0-rc.1", charts.LOCAL, {})
    assert found == {"artifacthub.io/prerelease": "true"}


@pytest.mark.parametrize("digests", [{"agent": "sha256:a"}, {**DIGESTS, "ros": "sha256:d"}])
def test_images_that_the_chart_does_not_have_are_refused(
    digests: dict[str, str], tmp_path: Path
) -> None:
    with pytest.raises(
        ReleaseError, match="The chart's images are agent, operator, spark, and the"
    ):
        charts.pack("bagpipe", NUMBER, tmp_path, "registry.example", digests)


def test_values_of_another_form_are_refused() -> None:
    values = 'images:\n  registry: "a"\n  digests:\n    {agent: "", operator: "", spark: ""}\n'
    with pytest.raises(ReleaseError, match="has another form than"):
        charts.pinned(values, "registry.example", DIGESTS)
