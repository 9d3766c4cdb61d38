"""A release is pushed into a real registry that asks for a login, and comes back byte for byte."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from release import archives, push, version
from tests.integration.release.registry import PASSWORD, Running, registry, small_release


@pytest.fixture(scope="module")
def release(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    folder = tmp_path_factory.mktemp("release") / "dist"
    return folder, small_release(folder)


@pytest.fixture
def running(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Running]:
    """An empty registry; clients have the right login, and none of the user's own."""
    with registry(tmp_path) as found:
        monkeypatch.setenv("DOCKER_CONFIG", str(found.login(PASSWORD)))
        monkeypatch.setenv("HELM_REGISTRY_CONFIG", str(tmp_path / "helm.json"))
        yield found


def names(running: Running) -> set[str]:
    """All repositories that the registry has."""
    return set(running.ask("crane", "catalog", running.name.partition("/")[0]).splitlines())


def test_what_was_pushed_is_pulled_by_its_digest(
    release: tuple[Path, dict[str, str]], running: Running, tmp_path: Path
) -> None:
    folder, digests = release
    number = version.version()
    assert push.main([str(folder), running.name, "--plain-http"]) == 0
    assert names(running) == {
        *(f"robots/{name}" for name in digests),
        "robots/charts/bagpipe",
        "robots/charts/bagpipe-namespace",
    }
    for name, digest in digests.items():
        assert running.ask("crane", "digest", f"{running.name}/{name}:{number}") == digest
        by_digest = f"{running.name}/{name}@{digest}"
        running.ask("crane", "pull", "--format=oci", by_digest, str(tmp_path / name))
        index = json.loads((tmp_path / name / "index.json").read_text())
        assert [each["digest"] for each in index["manifests"]] == [digest]
    running.ask(
        "helm", "pull", f"oci://{running.name}/charts/bagpipe", "--version", number,
        "--plain-http", "--destination", str(tmp_path),
    )  # fmt: skip
    package = f"bagpipe-{number}.tgz"
    assert (tmp_path / package).read_bytes() == (folder / "charts" / package).read_bytes()
    assert push.pins(tmp_path / package) == digests


def test_each_platform_finds_its_own_below_the_digest_that_the_chart_pins(
    release: tuple[Path, dict[str, str]], running: Running
) -> None:
    folder, digests = release
    assert push.main([str(folder), running.name, "--plain-http"]) == 0
    held = archives.inspect(folder / "images" / f"agent-{version.version()}.oci.tar")
    assert sorted(held.manifests) == ["linux/amd64", "linux/arm64"]
    pinned = f"{running.name}/agent@{digests['agent']}"
    for platform, digest in held.manifests.items():
        assert running.ask("crane", "digest", f"--platform={platform}", pinned) == digest
        config = json.loads(running.ask("crane", "config", f"--platform={platform}", pinned))
        assert f"{config['os']}/{config['architecture']}" == platform


def test_a_second_push_changes_nothing(
    release: tuple[Path, dict[str, str]], running: Running
) -> None:
    target = push.Registry(running.name, plain_http=True)
    first = push.push(release[0], target)
    assert push.push(release[0], target) == first
    assert len(set(first.values())) == 2


def test_the_chart_from_the_registry_names_the_pushed_images(
    release: tuple[Path, dict[str, str]], running: Running
) -> None:
    folder, digests = release
    assert push.main([str(folder), running.name, "--plain-http"]) == 0
    rendered = running.ask(
        "helm", "template", "bagpipe", f"oci://{running.name}/charts/bagpipe", "--plain-http",
        "--version", version.version(), "--set", f"images.registry={running.name}",
        "--set", "jobNamespaces={default}", "--namespace", "bagpipe-system",
        "--kube-version", "1.34", "--show-only", "templates/deployment.yaml",
    )  # fmt: skip
    (container,) = yaml.safe_load(rendered)["spec"]["template"]["spec"]["containers"]
    assert container["image"] == f"{running.name}/operator@{digests['operator']}"
    answer = {each["name"]: each.get("value", "") for each in container["env"]}
    for name in ("spark", "agent"):
        assert f"{running.name}/{name}@{digests[name]}" in answer.values()


def test_a_wrong_password_is_refused_in_a_sentence(
    release: tuple[Path, dict[str, str]],
    running: Running,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("DOCKER_CONFIG", str(running.login("wrong")))
    assert push.main([str(release[0]), running.name, "--plain-http"]) == 1
    answer = capsys.readouterr().err
    assert f"The registry {running.name} refuses the login: log in (docker login" in answer
    assert "wrong" not in answer
    assert names(running) == set()


def test_a_chart_whose_images_are_not_there_is_not_pushed(
    release: tuple[Path, dict[str, str]], running: Running, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, digests = release
    assert push.main([str(folder), running.name, "--plain-http", "--charts-only"]) == 1
    named = ", ".join(f"{name}@{digest}" for name, digest in sorted(digests.items()))
    assert capsys.readouterr().err == (
        f"Pushing the release failed. The registry {running.name} does not have {named}, which the"
        " chart pins: push the images first. No chart was pushed.\n"
    )
    assert names(running) == set()
    push.push_images(folder, version.version(), push.Registry(running.name, plain_http=True))
    assert push.main([str(folder), running.name, "--plain-http", "--charts-only"]) == 0


def test_a_registry_that_is_away_is_named(
    release: tuple[Path, dict[str, str]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert push.main([str(release[0]), "127.0.0.1:1/robots", "--plain-http"]) == 1
    assert "The registry 127.0.0.1:1/robots does not answer: is its name" in capsys.readouterr().err
