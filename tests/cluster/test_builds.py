"""Keys of builds, versions of tools, archives of images, mounts and steps."""

from __future__ import annotations

import dataclasses
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
import step
from embedded import builds, cleaning, images, oci, places, preflight, tools
from embedded.failure import ClusterError

SCRIPT = Path(step.__file__)


def environ(cache: Path) -> dict[str, str]:
    """A step's, which keeps what it keeps in a test's folder."""
    return {"PATH": "/usr/bin:/bin", "BAGPIPE_CACHE": str(cache)}


@pytest.fixture
def module(tmp_path: Path) -> Path:
    for name in ("go.mod", "go.sum", "main.go", "README.md"):
        (tmp_path / name).write_text(name)
    return tmp_path


def test_a_builds_key_follows_its_files(module: Path) -> None:
    program = builds.Program("kubernetes")
    before = builds.key(program, module)
    assert before.startswith("kubernetes-")
    assert len(before) == len("kubernetes-") + 16
    (module / "README.md").write_text("changed")
    assert builds.key(program, module) == before
    (module / "beside").mkdir()
    (module / "beside" / "main.go").write_text("beside")
    before, without = builds.key(program, module), before
    assert before != without
    for name in ("go.mod", "go.sum", "main.go", "beside/main.go"):
        kept = (module / name).read_text()
        (module / name).write_text(kept + "x")
        assert builds.key(program, module) != before
        (module / name).write_text(kept)


def test_a_builds_key_follows_its_flags(module: Path) -> None:
    program = builds.Program("kubernetes")
    other = dataclasses.replace(program, variables=(("version", "2"),))
    tagged = dataclasses.replace(program, tags=("only_this",))
    beside = dataclasses.replace(program, beside=(("other", "./other"),))
    quick = dataclasses.replace(program, compiler="-l")
    chosen = (program, other, tagged, beside, quick)
    assert len({builds.key(each, module) for each in chosen}) == 5


def test_a_build_has_the_tags_that_it_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "sources" / "tagged"
    folder.mkdir(parents=True)
    (folder / "go.mod").write_text("module tagged\n\ngo 1.24.0\n")
    (folder / "main.go").write_text("package main\n\nfunc main() { println(word) }\n")
    for tag, word in (("!loud", "quiet"), ("loud", "loud")):
        text = f'//go:build {tag}\n\npackage main\n\nconst word = "{word}"\n'
        (folder / f"{word}.go").write_text(text)
    monkeypatch.setattr(builds, "sources", lambda: tmp_path / "sources")
    monkeypatch.setattr(builds, "cache", lambda: tmp_path / "cache")
    for tags, word in (((), "quiet"), (("loud", "other"), "loud")):
        made = builds.ensure(builds.Program("tagged", tags=tags))
        done = subprocess.run([made / "tagged"], capture_output=True, text=True, check=True)
        assert done.stderr.strip() == word


def test_programs_of_one_module_are_built_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "sources" / "first"
    (folder / "second").mkdir(parents=True)
    (folder / "go.mod").write_text("module first\n\ngo 1.24.0\n")
    for place, word in ((folder, "one"), (folder / "second", "two")):
        text = f'package main\n\nfunc main() {{ println("{word}") }}\n'
        (place / "main.go").write_text(text)
    monkeypatch.setattr(builds, "sources", lambda: tmp_path / "sources")
    monkeypatch.setattr(builds, "cache", lambda: tmp_path / "cache")
    program = builds.Program(
        "first", links=("alias",), beside=(("second", "./second"),), compiler="-l -dwarf=false"
    )
    made = builds.ensure(program)
    words = {
        name: subprocess.run([made / name], capture_output=True, text=True, check=True).stderr
        for name in program.names
    }
    assert words == {"first": "one\n", "alias": "one\n", "second": "two\n"}


def test_a_failed_build_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sources" / "broken").mkdir(parents=True)
    (tmp_path / "sources" / "broken" / "go.mod").write_text("module broken\n\ngo 1.24.0\n")
    (tmp_path / "sources" / "broken" / "main.go").write_text("package main\n\nfunc main() { x }\n")
    monkeypatch.setattr(builds, "sources", lambda: tmp_path / "sources")
    monkeypatch.setattr(builds, "cache", lambda: tmp_path / "cache")
    with pytest.raises(ClusterError, match="undefined: x"):
        builds.ensure(builds.Program("broken"))
    assert list((tmp_path / "cache" / "bin").iterdir()) == []


def test_every_component_is_a_link_of_the_one_binary() -> None:
    assert builds.PROGRAMS[0].links[0] == "etcd"
    main = (places.sources() / "kubernetes" / "main.go").read_text()
    assert all(f'"{name}"' in main for name in builds.PROGRAMS[0].links)
    module = (places.sources() / "kubernetes" / "go.mod").read_text()
    assert f"k8s.io/kubernetes v{builds.KUBERNETES}\n" in module
    assert module.count("=> k8s.io/") == module.count("v0.34.4\n") - 2 == 29
    helm = dict(builds.PROGRAMS[0].variables)["helm.sh/helm/v3/internal/version.version"]
    assert f"helm.sh/helm/v3 {helm} " in module


@pytest.mark.parametrize(
    ("text", "version"),
    [
        ('{"clientVersion": {"gitVersion": "v1.32.4-dispatcher"}}', (1, 32)),
        ('{"clientVersion": {"gitVersion": "v1.34.4"}}', (1, 34)),
        ("v3.19.5", (3, 19)),
        ("no such option", None),
        ("[]", None),
    ],
)
def test_reads_the_versions_of_tools(text: str, version: tuple[int, int] | None) -> None:
    assert tools.parse_version(text) == version


@pytest.mark.parametrize(
    ("text", "version"),
    [
        ("go version go1.26.8 linux/amd64", (1, 26, 8)),
        ('openjdk version "17.0.15" 2025-04-15', (17, 0, 15)),
        ("nothing", ()),
    ],
)
def test_reads_the_versions_of_languages(text: str, version: tuple[int, ...]) -> None:
    assert preflight.version_in(text) == version


def test_says_what_an_old_language_is_needed_for() -> None:
    command = [sys.executable, "-c", "print('go version go1.19.8 linux/amd64')"]
    message = preflight.tool("Go", command, (1, 24), "build Kubernetes 1.34")
    assert message == "Go is 1.19.8, and build Kubernetes 1.34 needs 1.24 or newer."
    gone = preflight.tool("Go", ["no-such-program"], (1, 24), "build Kubernetes 1.34")
    assert gone == "Go is missing: 1.24 or newer is needed to build Kubernetes 1.34."


def test_a_pipe_carries_bytes_here(tmp_path: Path) -> None:
    assert preflight.fifo_works(tmp_path)


def test_writes_an_archive_that_names_its_image(tmp_path: Path) -> None:
    (tmp_path / "pause").write_bytes(b"program")
    for name in ("one", "two"):
        oci.write_single_binary(
            tmp_path / name, "bagpipe.local/pause:1", tmp_path / "pause", "/pause"
        )
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()
    found = oci.names_and_digests(tmp_path / "one")
    assert list(found) == ["bagpipe.local/pause:1"]
    assert found["bagpipe.local/pause:1"].startswith("sha256:")


def test_says_that_a_file_is_no_archive(tmp_path: Path) -> None:
    (tmp_path / "x.tar").write_bytes(b"nothing of the kind")
    with pytest.raises(ClusterError, match="is not an OCI image archive"):
        oci.names_and_digests(tmp_path / "x.tar")


def test_reads_containerds_list_of_images() -> None:
    text = (
        "REF                   TYPE                 DIGEST     SIZE      PLATFORMS   LABELS\n"
        "bagpipe.local/ros:0.1 application/vnd.oci  sha256:ab  10.0 MiB  linux/amd64 -\n"
    )
    assert images.parse_listing(text) == {"bagpipe.local/ros:0.1": "sha256:ab"}


def test_finds_mounts_of_ours_latest_first() -> None:
    text = (
        "20 1 8:1 / / rw - ext4 /dev/vda rw\n"
        "31 20 0:30 / /var/lib/bagpipe/a rw - tmpfs tmpfs rw\n"
        "32 31 0:31 / /var/lib/bagpipe/a/b\\040c rw - tmpfs tmpfs rw\n"
        "33 20 0:32 / /var/lib/bagpipes rw - tmpfs tmpfs rw\n"
    )
    roots = [Path("/var/lib/bagpipe")]
    assert cleaning.parse_mounts(text, roots) == ["/var/lib/bagpipe/a/b c", "/var/lib/bagpipe/a"]


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.04, "0.0 s"), (9.94, "9.9 s"), (34.2, "34 s"), (306.4, "5 min 06 s")]
)
def test_says_durations_as_people_do(seconds: float, text: str) -> None:
    assert step.duration(seconds) == text


def test_a_failed_step_says_what_to_do(tmp_path: Path) -> None:
    words = ["Building", "--if-it-fails", "Try again.", "--", "sh", "-c", "exit 7"]
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *words],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=environ(tmp_path),
    )
    assert done.returncode == 7
    assert done.stdout == "==> Building\n"
    first, second = done.stderr.splitlines()
    assert re.fullmatch(r"<== FAILED after [\d.]+ s: Building \(status 7\)\.", first)
    assert second == "    Try again."


def test_a_summary_has_the_longest_step_first(tmp_path: Path) -> None:
    record = tmp_path / "steps.jsonl"
    environment = environ(tmp_path) | {"BAGPIPE_STEPS": str(record)}
    for what, command in (("Looking", "true"), ("Failing", "false")):
        words = [sys.executable, str(SCRIPT), what, "--", command]
        subprocess.run(words, env=environment, check=False, timeout=120)
    kept = record.read_text().splitlines()
    assert ['"what": "Looking"' in kept[0], '"what": "Failing"' in kept[1]] == [True, True]
    names = ("what", "ended", "seconds", "processor")
    steps = [("Building", 171, 71.4, 90), ("Loading", 230, 130, 4.5), ("Checking", 99, 0.6, 0.1)]
    lines = [json.dumps(dict(zip(names, each, strict=True))) for each in steps]
    assert step.summary([]) == ""
    assert step.summary(lines).splitlines() == [
        "           took   of a processor  step",
        "     2 min 10 s            4.5 s  Loading",
        "     1 min 11 s       1 min 30 s  Building",
        "     3 min 22 s       1 min 35 s  all steps, each by itself",
        "     2 min 12 s       1 min 35 s  from the first to the last",
    ]


def test_a_step_says_how_long_it_took_the_last_time(tmp_path: Path) -> None:
    kept = tmp_path / "steps"
    first = " (the first time: 9 min 24 s on two processors)"
    assert step.expectation("Building Kubernetes", kept) == first
    assert step.expectation("Testing whole jobs", kept) == ""
    step.remember("Building Kubernetes", 123.4, kept)
    assert step.expectation("Building Kubernetes", kept) == " (the last time: 2 min 03 s)"
    step.remember("Building Kubernetes", 0.4, kept)  # nothing was to be built
    assert step.expectation("Building Kubernetes", kept) == ""
    assert [path.name for path in kept.iterdir()] == ["Building-Kubernetes"]
    (kept / "Building-Kubernetes").write_text("")
    assert step.expectation("Building Kubernetes", kept) == first


def test_a_cache_that_cannot_be_written_fails_no_step(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    step.remember("Looking", 1.0, tmp_path / "file")


def test_a_step_may_keep_its_output_until_its_end(tmp_path: Path) -> None:
    script = "import sys; print('out', flush=True); print('err', file=sys.stderr, flush=True)"
    words = [sys.executable, str(SCRIPT), "Showing", "--output-at-its-end", "--"]
    done = subprocess.run(
        [*words, sys.executable, "-c", script + "; sys.exit(3)"],
        env=environ(tmp_path), capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 3
    file = tmp_path / "steps/Showing.log"
    notice = f"    its output comes at its end, and stands in {file} until then"
    assert done.stdout == f"==> Showing\n{notice}\nout\nerr\n"
    assert file.read_text() == "out\nerr\n"
    assert "FAILED after" in done.stderr


def test_a_step_has_the_processors_that_its_processes_used(tmp_path: Path) -> None:
    record = tmp_path / "steps.jsonl"
    environment = environ(tmp_path) | {"BAGPIPE_STEPS": str(record)}
    busy = "import time\nwhile time.process_time() < 0.3: pass"
    words = [sys.executable, str(SCRIPT), "Computing", "--", sys.executable, "-c", busy]
    subprocess.run(words, env=environment, check=True, timeout=120)
    assert json.loads(record.read_text())["processor"] >= 0.3


def test_a_program_has_the_name_of_its_module_s_folder() -> None:
    assert builds.named("helm-unittest") is builds.CHART_TESTS
    with pytest.raises(
        ClusterError, match="no program nothing: it can be crane, helm-unittest, kubeadm"
    ):
        builds.named("nothing")


def test_all_that_make_test_builds_shares_the_compiler_s_settings() -> None:
    makefile = Path(__file__).parents[2] / "Makefile"
    rule = makefile.read_text().partition("\ntest-programs:")[2].partition("\n\n")[0]
    folders = rule.partition(" build ")[2].split()
    assert "versitygw" in folders
    programs = [*builds.PROGRAMS, *map(builds.named, folders)]
    assert {program.compiler for program in programs} == {builds.QUICK_TO_COMPILE}


@pytest.mark.parametrize("peer", [builds.SPARK_OPERATOR, builds.KWOK])
def test_what_is_measured_has_its_authors_settings(peer: builds.Program) -> None:
    assert peer.compiler == ""
