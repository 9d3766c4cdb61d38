"""What `bagpipe init --image` finds in an image, of which nothing is ever run."""

import gzip
import hashlib
import io
import json
import os
import tarfile
from pathlib import Path
from typing import Any

import pytest

from bagpipe.cli.first_job import stack_image
from bagpipe.cli.first_job.stack_image import Files, ImageError, StackImage, look_at

ROS1 = frozenset({"ros1"})
NOETIC = ["opt/ros/noetic/setup.bash", "opt/ros/noetic/bin/rosmaster", "ros_entrypoint.sh"]
CONFIG = {"Entrypoint": ["/ros_entrypoint.sh"], "User": "", "Env": ["ROS_DISTRO=noetic", 7]}


def layer(*names: str) -> bytes:
    made = io.BytesIO()
    with tarfile.open(fileobj=made, mode="w") as tar:
        for name in names:
            tar.addfile(tarfile.TarInfo(name), io.BytesIO())
    return made.getvalue()


def saved(path: Path, layers: list[bytes], config: object = None, tag: str = "lane:1.4") -> Path:
    """As `docker save` writes it."""
    whole = json.dumps({"config": CONFIG if config is None else config}).encode()
    names = [f"layer{number}.tar" for number in range(len(layers))]
    manifest = [{"Config": "config.json", "RepoTags": [tag] if tag else None, "Layers": names}]
    files = {"manifest.json": json.dumps(manifest).encode(), "config.json": whole}
    with tarfile.open(path, "w") as tar:
        for name, data in (files | dict(zip(names, layers, strict=True))).items():
            info = tarfile.TarInfo(name)
            info.size = len(data)
            tar.addfile(info, io.BytesIO(data))
    return path


def layout(folder: Path, layers: list[bytes], name: str = "lane:1.4") -> Path:
    """As an OCI layout has it, with an index of an index."""

    def blob(data: bytes) -> dict[str, Any]:
        digest = hashlib.sha256(data).hexdigest()
        (folder / "blobs/sha256").mkdir(parents=True, exist_ok=True)
        (folder / f"blobs/sha256/{digest}").write_bytes(data)
        return {"digest": f"sha256:{digest}", "size": len(data)}

    config = blob(json.dumps({"config": CONFIG}).encode())
    manifest = {"config": config, "layers": [blob(data) for data in layers]}
    inner = {"manifests": [blob(json.dumps(manifest).encode())]}
    outer = blob(json.dumps(inner).encode())
    outer["annotations"] = {"org.opencontainers.image.ref.name": name}
    (folder / "index.json").write_text(json.dumps({"manifests": [outer]}))
    return folder


def test_an_archive_shows_ros_1_and_what_starts_it(tmp_path: Path) -> None:
    found = look_at(str(saved(tmp_path / "a.tar", [layer("usr/bin/sh"), layer(*NOETIC)])))
    assert found.name == "lane:1.4"
    assert found.files == Files(ROS1, True, ("noetic",))
    assert found.sentences("ros1") == [
        "Found: entrypoint ['/ros_entrypoint.sh'], user root.",
        "Found: ROS_DISTRO=noetic.",
        "Found: ROS in /opt/ros/noetic.",
        "Found: ROS 1.",
    ]


@pytest.mark.parametrize("packed", [bytes, gzip.compress], ids=["plain", "gzip"])
def test_a_folder_of_an_image_is_read_through_its_indexes(tmp_path: Path, packed: Any) -> None:
    jazzy = layer("./opt/ros/jazzy/setup.bash", "./opt/ros/jazzy/bin/ros2")
    found = look_at(str(layout(tmp_path, [packed(jazzy)])))
    assert found.files == Files(frozenset({"ros2"}), False, ("jazzy",))
    shown = found.sentences("ros2")
    assert "Found: ROS 2." in shown
    assert any(each.startswith("MISSING: /ros_entrypoint.sh: write a command") for each in shown)
    assert any(each.startswith("MISSING: ROS 1") for each in found.sentences("ros1"))


def test_what_an_upper_layer_removes_is_not_there(tmp_path: Path) -> None:
    gone = layer("opt/ros/noetic/bin/.wh.rosmaster", ".wh.ros_entrypoint.sh")
    found = look_at(str(saved(tmp_path / "a.tar", [layer(*NOETIC), gone])))
    assert found.files == Files(frozenset(), False, ("noetic",))
    opaque = layer("opt/.wh..wh..opq", "usr/bin/rosmaster")
    found = look_at(str(saved(tmp_path / "b.tar", [layer(*NOETIC), opaque])))
    assert found.files == Files(ROS1, True, ())


def test_an_image_without_ros_lacks_it(tmp_path: Path) -> None:
    found = look_at(str(saved(tmp_path / "a.tar", [layer("usr/bin/sh")], {"Entrypoint": ["/run"]})))
    assert found.sentences("ros2") == [
        "Found: entrypoint ['/run'], user root.",
        (
            "Its entrypoint is not used: a job's command runs as it is written, through"
            " /ros_entrypoint.sh alone."
        ),
        "MISSING: ROS 2, which stack.engine: ros2 needs: begin with an image such as ros:jazzy.",
    ]


@pytest.mark.parametrize("tag", ["", "a b", "x\x1b[31m"])
def test_an_archive_without_a_good_name_says_so(tmp_path: Path, tag: str) -> None:
    found = look_at(str(saved(tmp_path / "a.tar", [layer(*NOETIC)], tag=tag)))
    assert found.name == "registry.example/your-stack:1"
    assert "CHANGE: the archive has no name of the image: write it" in found.unseen


def test_what_can_t_be_unpacked_is_unknown_and_not_missing(tmp_path: Path) -> None:
    for number, data in enumerate([b"\x28\xb5\x2f\xfdzstd", b"\x1f\x8bbroken", b"x" * 700]):
        found = look_at(str(saved(tmp_path / f"{number}.tar", [layer(*NOETIC), data])))
        assert found.files is None
        assert [each.startswith("Its files were not seen") for each in found.unseen] == [True]
        assert not any("MISSING" in each for each in found.sentences("ros1"))


def test_names_without_end_and_files_without_number_are_no_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flood = tarfile.TarInfo("././@LongLink")
    flood.type, flood.size = tarfile.GNUTYPE_LONGNAME, 2 << 30
    # In a layer it is a fault of that, and in the archive of the whole.
    found = look_at(str(saved(tmp_path / "a.tar", [layer(*NOETIC), flood.tobuf() + bytes(1024)])))
    assert "a member's name has 2,147,483,648 bytes" in found.unseen[0]
    (tmp_path / "b.tar").write_bytes(flood.tobuf() + bytes(1024))
    with pytest.raises(ImageError, match="a member's name has 2,147,483,648 bytes"):
        look_at(str(tmp_path / "b.tar"))
    monkeypatch.setattr(stack_image, "_MOST_FILES", 3)
    many = saved(tmp_path / "c.tar", [layer("a"), layer("b")])
    with pytest.raises(ImageError, match="it has more than 3 files"):
        look_at(str(many))


def test_a_layer_that_never_ends_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    zeros = tarfile.TarInfo("zeros")
    zeros.size = 64 << 20
    bomb = gzip.compress(zeros.tobuf() + bytes(zeros.size))
    archive = str(saved(tmp_path / "a.tar", [layer("a"), bomb]))
    monkeypatch.setattr(stack_image, "_MOST_LAYER_BYTES", 20 << 10)
    assert "are larger than this program reads" in look_at(archive).unseen[0]
    monkeypatch.setattr(stack_image, "_MOST_LAYER_BYTES", 16 << 30)
    moments = iter(range(0, 10_000, 61))
    assert "take longer than 60 s" in look_at(archive, lambda: float(next(moments))).unseen[0]


@pytest.mark.parametrize(
    "manifest",
    [
        b"{}", b"[]", b"[{}]", b"[3]", b"[" * 100_000, b"no json", b'[{"Config": 1, "Layers": []}]',
        b'[{"Config": "../../etc/passwd", "Layers": []}]', b'[{"Config": "c", "Layers": null}]',
    ],
)  # fmt: skip
def test_what_is_no_image_is_refused(tmp_path: Path, manifest: bytes) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder/manifest.json").write_bytes(manifest)
    with pytest.raises(ImageError, match="this is no image"):
        look_at(str(tmp_path / "folder"))


def test_a_link_out_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    folder = layout(tmp_path / "a", [layer(*NOETIC)])
    outside = tmp_path / "outside.json"
    outside.write_bytes((folder / "index.json").read_bytes())
    (folder / "index.json").unlink()
    (folder / "index.json").symlink_to(outside)
    with pytest.raises(ImageError, match="this is no image"):
        look_at(str(folder))


def test_a_file_that_is_no_archive_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.tar").write_bytes(b"nothing")
    with pytest.raises(ImageError, match="is no archive of an image"):
        look_at(str(tmp_path / "a.tar"))


def tool(folder: Path, text: str) -> None:
    folder.mkdir(exist_ok=True)
    (folder / "docker").write_text(f"#!/bin/sh\n{text}\n")
    (folder / "docker").chmod(0o755)


def test_a_name_is_asked_of_docker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = json.dumps([{"Config": CONFIG | {"User": "ros"}}])
    tool(tmp_path / "bin", f"[ \"$*\" = 'image inspect -- lane:1.4' ] && echo '{config}'")
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    found = look_at("lane:1.4")
    assert found.sentences("ros1")[0] == "Found: entrypoint ['/ros_entrypoint.sh'], user ros."
    assert "`docker save lane:1.4 -o stack.tar`" in found.sentences("ros1")[-1]


@pytest.mark.parametrize("answer", ["exit 1", "echo no json", "echo '[]'", "echo '[{}]'"])
def test_an_image_that_no_tool_has_is_unknown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: str
) -> None:
    tool(tmp_path / "bin", answer)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/bin:/bin")
    monkeypatch.setattr(stack_image, "_TOOLS", ("docker",))
    assert look_at("lane:1.4") == StackImage("lane:1.4", None, None, look_at("lane:1.4").unseen)
    assert look_at("lane:1.4").unseen[0].startswith("Nothing of the image was seen")


def test_a_tool_that_hangs_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tool(tmp_path / "bin", "exec sleep 600")
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/bin:/bin")
    monkeypatch.setattr(stack_image, "_TOOLS", ("docker",))
    monkeypatch.setattr(stack_image, "_ASK_SECONDS", 0.2)
    assert look_at("lane:1.4").unseen[0].startswith("Nothing of the image was seen")


@pytest.mark.parametrize("name", ["-v", "a b", "$(x)", "", "--help"])
def test_what_is_no_name_is_refused(name: str) -> None:
    with pytest.raises(ImageError, match="is no image's name"):
        look_at(name or "\n")
