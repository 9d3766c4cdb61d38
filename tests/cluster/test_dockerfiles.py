"""The Dockerfiles keep to what Docker and buildah both know; BuildKit's own parser reads them."""

import re
from pathlib import Path

import dockerfile
import engines
import pytest
from context import IMAGES, ROOT

# Its base, the official image of ROS 2, is none of those that are built here.
OF_ROS2 = ROOT / "docs/examples/ros2/Dockerfile"
FILES = sorted({image.dockerfile for image in IMAGES} | {OF_ROS2})
WORDS = {"FROM", "RUN", "COPY", "ENV", "WORKDIR", "USER", "CMD", "ENTRYPOINT"}
MOUNT = re.compile(
    r"--mount=type=(secret,id=(pip-conf|ca),target=/[\w./-]+|cache,target=/root/\.cache/pip)"
)
# Those that pip works for.
OURS = [ROOT / "images/operator/Dockerfile", ROOT / "images/spark/Dockerfile"]


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def faults(text: str) -> list[str]:
    """What only one of the two would build, or each in its own way."""
    found = []
    first = text.lstrip().splitlines()[0].replace(" ", "").lower()
    if first.startswith(("#syntax=", "#escape=", "#check=")):
        found.append(f"{first}: buildah reads no directive")
    stages: list[str] = []
    for command in dockerfile.parse_string(text):
        word, where = command.cmd.upper(), f"line {command.start_line}"
        if word not in WORDS:
            found.append(f"{where}: {word} is not among {sorted(WORDS)}")
        if "<<" in command.original:
            found.append(f"{where}: buildah 1.28 knows no here-document")
        for flag in command.flags:
            known = {"RUN": MOUNT.fullmatch(flag), "COPY": flag in [f"--from={s}" for s in stages]}
            if not known.get(word):
                found.append(f"{where}: {flag} of {word}")
        if word == "FROM" and len(command.value) == 3:
            stages.append(command.value[2])
    return found


def stages_of(path: Path) -> list[list[dockerfile.Command]]:
    """The commands of a Dockerfile, stage by stage."""
    found: list[list[dockerfile.Command]] = []
    for command in dockerfile.parse_file(str(path)):
        if command.cmd.upper() == "FROM":
            found.append([])
        found[-1].append(command)
    return found


def test_all_dockerfiles_are_looked_at() -> None:
    assert len(FILES) == 11
    tops = ("images", "docs", "tests")
    assert {p for top in tops for p in (ROOT / top).rglob("Dockerfile")} == set(FILES)


@pytest.mark.parametrize("path", FILES, ids=name)
def test_docker_and_buildah_both_know_every_construct(path: Path) -> None:
    assert faults(path.read_text()) == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# syntax=docker/dockerfile:1\nFROM a\n", "buildah reads no directive"),
        ("FROM a\nRUN <<END\nls\nEND\n", "no here-document"),
        ("FROM a\nCOPY --link x /x\n", "--link of COPY"),
        ("FROM a\nCOPY --from=b x /x\n", "--from=b of COPY"),
        ("FROM a\nRUN --mount=type=ssh ls\n", "--mount=type=ssh of RUN"),
        ("FROM a\nRUN --network=none ls\n", "--network=none of RUN"),
        ("FROM a\nADD https://example.org/x /x\n", "ADD is not among"),
        ("FROM --platform=linux/amd64 a\n", "--platform=linux/amd64 of FROM"),
    ],
)
def test_what_one_of_them_lacks_is_found(text: str, words: str) -> None:
    assert words in " ".join(faults(text))


def in_image(stages: list[list[dockerfile.Command]]) -> list[dockerfile.Command]:
    """The commands of the last stage, after those of the stages that it begins with."""
    named = {stage[0].value[2]: stage for stage in stages if len(stage[0].value) == 3}
    found = list(stages[-1])
    while found[0].value[0] in named:
        found = named[found[0].value[0]] + found[1:]
    return found


@pytest.mark.parametrize("path", OURS, ids=name)
def test_what_builds_an_image_of_ours_stays_out_of_it(path: Path) -> None:
    stages = stages_of(path)
    final = in_image(stages)
    assert "python3-venv" in " ".join(command.original for stage in stages for command in stage)
    words = " ".join(command.original for command in final)
    assert not re.search(r"python3-venv|pip |--mount|requirements", words)
    copied = {c.value: c.flags for c in final if c.cmd.upper() == "COPY"}
    assert copied["/opt/bagpipe", "/opt/bagpipe"] == ("--from=packages",)
    assert [c.value for c in final if c.cmd.upper() == "USER"] == [("10001",)]


def test_old_dockers_are_asked_for_buildkit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BAGPIPE_CACHE", str(tmp_path / "cache"))
    log = tmp_path / "log"
    engines.run(["sh", "-c", "echo $DOCKER_BUILDKIT $BUILDKIT_PROGRESS"], log=log)
    assert log.read_text() == "1 plain\n"
