"""Images of several platforms: one index over their archives, and what a release says of them."""

from __future__ import annotations

import json
import tarfile
from pathlib import Path

import build
import context
import pytest
import yaml
from cross import TARGETS, own
from embedded import oci

from release import ReleaseError, archives, charts, make, push, sbom, version

NAME = "bagpipe.local/agent:1"


def archive_of(folder: Path, arch: str, content: bytes = b"", name: str = NAME) -> Path:
    """An archive of one program; of the same content unless another is given."""
    program, path = folder / f"{arch}-program", folder / f"{arch}.tar"
    program.write_bytes(content or arch.encode())
    oci.write_single_binary(path, name, program, "/program", arch)
    return path


@pytest.fixture
def both(tmp_path: Path) -> Path:
    """An archive of two platforms."""
    parts = [archive_of(tmp_path, "amd64"), archive_of(tmp_path, "arm64")]
    archives.join(parts, tmp_path / "both.tar", NAME)
    return tmp_path / "both.tar"


def test_the_index_has_each_platform_s_own_manifest(both: Path, tmp_path: Path) -> None:
    parts = {each: archives.inspect(tmp_path / f"{each}.tar").digest for each in ("amd64", "arm64")}
    found = archives.inspect(both)
    assert found.name == NAME
    assert found.platforms == "linux/amd64,linux/arm64"
    assert found.manifests == {f"linux/{arch}": digest for arch, digest in parts.items()}
    assert found.digest not in parts.values()
    assert oci.names_and_digests(both) == {NAME: found.digest}


def test_the_same_archives_give_the_same_bytes(both: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.tar"
    archives.join([tmp_path / "amd64.tar", tmp_path / "arm64.tar"], again, NAME)
    assert again.read_bytes() == both.read_bytes()


def test_what_two_platforms_share_is_in_the_archive_once(tmp_path: Path) -> None:
    parts = [archive_of(tmp_path, "amd64", b"same"), archive_of(tmp_path, "arm64", b"same")]
    archives.join(parts, tmp_path / "both.tar", NAME)
    with tarfile.open(tmp_path / "both.tar") as tar:
        names = tar.getnames()
    assert len(names) == len(set(names))
    # A layer, and for each platform a configuration and a manifest; and the index over them.
    assert len([name for name in names if name.startswith("blobs/")]) == 6
    assert archives.inspect(tmp_path / "both.tar").platforms == "linux/amd64,linux/arm64"


def rewritten(source: Path, target: Path, old: bytes, new: bytes) -> Path:
    """The archive with another text in its index, whose digest is then right again."""
    with tarfile.open(source) as tar:
        files = {m.name: f.read() for m in tar if (f := tar.extractfile(m))}
    top = json.loads(files["index.json"])
    digest = top["manifests"][0]["digest"]
    index = files.pop("blobs/" + digest.replace(":", "/"))
    assert old in index
    changed = index.replace(old, new)
    with tarfile.open(target, "w") as tar:
        layout = oci._Layout(tar)
        for name, content in files.items():
            if name != "index.json":
                layout.file(name, content)
        top["manifests"][0] |= layout.blob(archives.INDEX, changed)
        layout.file("index.json", json.dumps(top).encode())
    return target


def test_an_index_that_takes_one_platform_for_another_is_refused(
    both: Path, tmp_path: Path
) -> None:
    lie = rewritten(
        both, tmp_path / "lie.tar", b'"architecture": "arm64"', b'"architecture": "s390x"'
    )
    with pytest.raises(
        ReleaseError, match=r"an image of linux/arm64 in the place of one of linux/s390x"
    ):
        archives.inspect(lie)
    twice = [tmp_path / "amd64.tar", tmp_path / "amd64.tar"]
    archives.join(twice, tmp_path / "twice.tar", NAME)
    with pytest.raises(ReleaseError, match="an image of linux/amd64 in the place of one of"):
        archives.inspect(tmp_path / "twice.tar")


def test_an_index_without_one_of_its_images_is_refused(both: Path, tmp_path: Path) -> None:
    digest = archives.inspect(both).manifests["linux/arm64"].encode()
    other = rewritten(both, tmp_path / "cut.tar", digest, b"sha256:" + b"0" * 64)
    with pytest.raises(ReleaseError, match=r"lacks sha256:0000.*, which its index names"):
        archives.inspect(other)


def test_an_index_is_not_joined_again(both: Path, tmp_path: Path) -> None:
    with pytest.raises(ReleaseError, match=r"both\.tar is of several platforms already"):
        archives.join([both, tmp_path / "arm64.tar"], tmp_path / "more.tar", NAME)


@pytest.fixture
def built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache with the images of a release: the agent for both, and the others for this machine."""
    monkeypatch.setenv("BAGPIPE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(context, "unemulated", lambda _target: "nothing emulates it")

    def listed(_archive: Path, name: str, number: str, arch: str, folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        (folder / f"{name}-{number}-{arch}").touch()

    monkeypatch.setattr(sbom, "of_image", listed)
    others = [image for target in TARGETS if target != own() for image in context.foreign(target)]
    for image in [*context.IMAGES, *others]:
        path = build.archive_of(image)
        path.parent.mkdir(parents=True, exist_ok=True)
        made = archive_of(tmp_path, (image.target or own()).arch, b"", image.reference)
        made.replace(path)
        record = {"content": "x", "size": path.stat().st_size}
        path.with_suffix(".json").write_text(json.dumps(record))
    return tmp_path


def test_a_release_lists_what_is_pushed_and_what_each_platform_gets(built: Path) -> None:
    folder, number = built / "dist", version.version()
    targets = sorted(TARGETS, key=lambda each: each != own())
    found = make.images(number, folder, targets)
    assert {name: sorted(each.manifests) for name, each in found.items()} == {
        "agent": ["linux/amd64", "linux/arm64"],
        "operator": [own().platform],
        "spark": [own().platform],
    }
    assert push.digests(folder) == {name: each.digest for name, each in found.items()}
    lines = (folder / make.MANIFESTS).read_text().splitlines()
    assert f"agent linux/arm64 {found['agent'].manifests['linux/arm64']}" in lines
    assert len(lines) == 4
    assert {path.name for path in (folder / "sbom").iterdir()} == {
        f"agent-{number}-amd64", f"agent-{number}-arm64", f"operator-{number}-{own().arch}",
        f"spark-{number}-{own().arch}",
    }  # fmt: skip
    assert archives.inspect(folder / "images" / f"agent-{number}.oci.tar").name == (
        f"bagpipe.local/agent:{number}"
    )


def test_an_archive_of_the_wrong_machine_is_no_part_of_a_release(built: Path) -> None:
    (other,) = (target for target in TARGETS if target != own())
    (image,) = context.foreign(other)
    path = build.archive_of(image)
    archive_of(built, own().arch, b"program", image.reference).replace(path)
    record = {"content": "x", "size": path.stat().st_size}
    path.with_suffix(".json").write_text(json.dumps(record))
    with pytest.raises(ReleaseError, match=f"{image.reference} of {own().platform}: run `make"):
        make.images(version.version(), built / "dist", [own(), other])


def test_an_archive_that_was_not_built_is_named(built: Path) -> None:
    (other,) = (target for target in TARGETS if target != own())
    build.archive_of(context.foreign(other)[0]).unlink()
    with pytest.raises(ReleaseError, match=r"There is no whole .*/agent\.oci\.tar: run"):
        make.images(version.version(), built / "dist", [own(), other])


def test_what_is_not_for_all_platforms_is_named() -> None:
    both = ["linux/amd64", "linux/arm64"]
    why = {"linux/arm64": "there is no QEMU"}
    sentence = make.fewer({"agent": both, "spark": both[:1], "operator": both[:1]}, TARGETS, why)
    assert sentence == (
        "No image of operator and spark is for linux/arm64: building it runs programs of that"
        " architecture, and there is no QEMU."
    )
    assert make.fewer({"agent": both}, TARGETS, why) == ""


def test_artifact_hub_gets_the_platforms_of_each_image() -> None:
    digests = {"agent": "sha256:a", "spark": "sha256:b"}
    platforms = {"agent": ["linux/amd64", "linux/arm64"], "spark": ["linux/amd64"]}
    found = charts.hub_annotations({}, version.version(), charts.LOCAL, digests, platforms)
    images = yaml.safe_load(found["artifacthub.io/images"])
    assert {each["name"]: each["platforms"] for each in images} == platforms
