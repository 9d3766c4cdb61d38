"""Where a Docker engine gets the base image from. A script that notes its calls is the engine."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import engines
import pytest
from context import BASE
from failure import BuildError

DOCKER = """#!/bin/sh
cd "$(dirname "$0")"
[ "$1" = image ] || echo "$1" >> calls
case "$1" in
  image) cat held 2>&- ;;
  pull) if [ -e registry ]; then echo sha256:pulled > held; else echo no such host; exit 1; fi ;;
  import) echo "sha256:$(cat "$4") for $5" > held ;;
esac
"""
MMDEBSTRAP = """#!/bin/sh
printf made > "$4"
"""
# Without a namespace: the test may not be root's.
UNSHARE = """#!/bin/sh
shift
exec "$@"
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder first on PATH, with an engine that holds no image and reaches no registry."""
    for name, text in {"docker": DOCKER, "mmdebstrap": MMDEBSTRAP, "unshare": UNSHARE}.items():
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setenv("BAGPIPE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    return tmp_path


def calls(folder: Path) -> list[str]:
    return (folder / "calls").read_text().split()


def test_docker_is_asked_to_pull_the_base_once(folder: Path) -> None:
    (folder / "registry").touch()
    assert [engines.Docker().base(), engines.Docker().base()] == ["sha256:pulled"] * 2
    assert calls(folder) == ["pull"]


def test_docker_is_given_a_base_where_no_registry_answers(folder: Path) -> None:
    assert engines.Docker().base() == f"sha256:made for {BASE}"
    assert calls(folder) == ["pull", "import"]
    assert list(engines.temporary().iterdir()) == []


@pytest.mark.parametrize("lacks", ["mmdebstrap", "root"])
def test_what_docker_wrote_is_reported_where_no_base_can_be_made(
    folder: Path, monkeypatch: pytest.MonkeyPatch, lacks: str
) -> None:
    if lacks == "root":
        monkeypatch.setattr(os, "geteuid", lambda: 1000)
    else:
        monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(BuildError, match=r"docker pull .*\n.*no such host"):
        engines.Docker().base()
    assert calls(folder) == ["pull"]


@pytest.mark.usefixtures("folder")
def test_what_an_interrupted_making_of_a_base_left_is_removed() -> None:
    left = engines.temporary() / "debian-1.tar"
    left.touch()
    (engines.temporary() / "mmdebstrap.a").mkdir()
    engines.Docker().release()
    assert list(engines.temporary().iterdir()) == []


BUILDAH = """#!/bin/sh
cd "$(dirname "$0")"
while [ "${1#--}" != "$1" ]; do case "$1" in *=*) shift ;; *) shift 2 ;; esac; done
case "$1" in images) cat images ;; rmi) echo "$2" >> calls ;; esac
"""


def test_buildah_keeps_so_many_nameless_images_and_all_that_have_a_name(folder: Path) -> None:
    (folder / "buildah").write_text(BUILDAH)
    (folder / "buildah").chmod(0o755)
    (folder / "cache" / "buildah" / "storage").mkdir(parents=True)
    most = engines.KEPT_IMAGES
    nameless = [{"id": f"n{age}", "names": None, "created": 1000 - age} for age in range(most + 2)]
    named = [{"id": "named", "names": ["bagpipe.local/spark"], "created": 1}]
    (folder / "images").write_text(json.dumps([*reversed(nameless), *named]))
    engines.Buildah().release()
    assert calls(folder) == [f"n{most}", f"n{most + 1}"]
