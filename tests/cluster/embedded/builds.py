"""The Go programs of the cluster, built once per machine and kept in the cache.

A build's folder is named by the hash of all that decides what comes out of it. It appears
under its name only when it is complete, so an interrupted build leaves nothing to trip over.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from .failure import ClusterError
from .places import cache, sources

KUBERNETES = "1.34.4"
BUILD_SECONDS = 3000.0


@dataclass(frozen=True)
class Program:
    """A Go module below tests/cluster and what to build of it: one program with the folder's name,
    other names for it (`links`), and others of the same module beside it, by name and package.
    """

    folder: str
    package: str = "."
    variables: tuple[tuple[str, str], ...] = ()
    links: tuple[str, ...] = ()
    expect: str = "some seconds"
    tags: tuple[str, ...] = field(default=(), repr=False)
    beside: tuple[tuple[str, str], ...] = field(default=(), repr=False)
    compiler: str = field(default="", repr=False)

    @property
    def names(self) -> list[str]:
        """Of all programs that are in the folder when it is built."""
        return [self.folder, *self.links, *(name for name, _ in self.beside)]

    @property
    def ldflags(self) -> str:
        return " ".join(["-s", "-w", *(f"-X {name}={value}" for name, value in self.variables)])


VERSION = "k8s.io/component-base/version"
# Nobody debugs these programs, and few calls are worth inlining in a cluster that is thrown away:
# client-go took 123 s of processor time with both, and 79 s with neither. All that `make test`
# builds has the same: another choice would compile Go's own packages once more. A peer of a bench
# has its authors' settings.
QUICK_TO_COMPILE = "-l -dwarf=false"
MAJOR, MINOR, _PATCH = KUBERNETES.split(".")
OF_KUBERNETES = (
    (f"{VERSION}.gitVersion", f"v{KUBERNETES}"),
    (f"{VERSION}.gitMajor", MAJOR),
    (f"{VERSION}.gitMinor", MINOR),
    (f"{VERSION}.gitTreeState", "clean"),
)
PROGRAMS = [
    Program(
        "kubernetes",
        variables=(
            *OF_KUBERNETES,
            ("helm.sh/helm/v3/internal/version.version", "v3.19.5"),
        ),
        links=(
            "etcd",
            "kube-apiserver",
            "kube-controller-manager",
            "kube-scheduler",
            "kubelet",
            "kube-proxy",
            "kubectl",
        ),
        # In one module they share versions, so what they have in common is compiled once.
        beside=(("coredns", "./coredns"), ("helm", "helm.sh/helm/v3/cmd/helm")),
        compiler=QUICK_TO_COMPILE,
        expect="about six minutes on two cores",
    ),
    Program("pause", compiler=QUICK_TO_COMPILE),
]
# What a node of kind's has beyond those, built only where kind is tried.
KUBEADM = Program(
    "kubeadm",
    package="k8s.io/kubernetes/cmd/kubeadm",
    variables=OF_KUBERNETES,
    beside=(("resolver", "./resolver"),),
    compiler=QUICK_TO_COMPILE,
    expect="about a minute after Kubernetes",
)
# No part of the cluster: the tests of storage start it.
S3_SERVER = Program(
    "versitygw",
    package="github.com/versity/versitygw/cmd/versitygw",
    compiler=QUICK_TO_COMPILE,
    expect="about a minute",
)
# No part of the cluster either: the operator's bench starts them.
KWOK = Program("kwok", package="sigs.k8s.io/kwok/cmd/kwok", expect="about two minutes")
SPARK_OPERATOR = Program(
    "spark-operator",
    package="github.com/kubeflow/spark-operator/v2/cmd/operator",
    expect="about two minutes",
)
# No part of it either: the tests of the chart's templates run it.
CHART_TESTS = Program(
    "helm-unittest",
    package="github.com/helm-unittest/helm-unittest/cmd/helm-unittest",
    compiler=QUICK_TO_COMPILE,
    expect="about a minute",
)
# No part of it either: a test has it find a job's pods. Of its many discoveries only that one.
PROMETHEUS = Program(
    "prometheus",
    package="github.com/prometheus/prometheus/cmd/prometheus",
    expect="about five minutes on two cores",
    tags=("remove_all_sd", "enable_kubernetes_sd"),
)
# No parts of it either: what lists and pushes a release, and the registry of the tests of that.
CONTENTS = Program(
    "syft",
    package="github.com/anchore/syft/cmd/syft",
    compiler=QUICK_TO_COMPILE,
    expect="about three minutes on two cores",
)
PUSHER = Program(
    "crane",
    package="github.com/google/go-containerregistry/cmd/crane",
    compiler=QUICK_TO_COMPILE,
)
REGISTRY = Program(
    "registry",
    package="github.com/distribution/distribution/v3/cmd/registry",
    compiler=QUICK_TO_COMPILE,
    expect="about a minute",
)


def named(folder: str) -> Program:
    """The program of a module's folder; raises ClusterError where there is none."""
    others = [S3_SERVER, KWOK, SPARK_OPERATOR, CHART_TESTS, PROMETHEUS]
    known = [*PROGRAMS, KUBEADM, *others, CONTENTS, PUSHER, REGISTRY]
    for program in known:
        if program.folder == folder:
            return program
    folders = ", ".join(sorted(each.folder for each in known))
    raise ClusterError(f"there is no program {folder}: it can be {folders}.")


def key(program: Program, folder: Path) -> str:
    """The name of a build: a hash over the module's files and how it is built."""
    # Written only where there are some: a new kind of choice makes no old build stale.
    choices = (program.tags, program.beside, program.compiler)
    digest = hashlib.sha256(
        (repr(program) + "".join(repr(each) for each in choices if each)).encode()
    )
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".go" or path.name in {"go.mod", "go.sum"}:
            content = path.read_bytes()
            digest.update(f"{path.relative_to(folder)} {len(content)}\n".encode() + content)
    return f"{program.folder}-{digest.hexdigest()[:16]}"


def compile_into(program: Program, folder: Path, target: Path) -> None:
    """Run the Go compiler; the caller's folder `target` gets the program."""
    environment = {**os.environ, "CGO_ENABLED": "0", "GOFLAGS": "-buildvcs=false"}
    command = ["go", "build", "-trimpath", "-tags", ",".join(program.tags)]
    command += [f"-gcflags=all={program.compiler}", "-ldflags", program.ldflags, "-o"]
    # Several can only be written into a folder, each with the name of its package.
    written = f"{target}/" if program.beside else str(target / program.folder)
    done = subprocess.run(
        [*command, written, program.package, *(package for _, package in program.beside)],
        cwd=folder,
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
        timeout=BUILD_SECONDS,
        check=False,
    )
    if done.returncode:
        last = "\n".join(done.stderr.splitlines()[-20:])
        raise ClusterError(
            f"Building {program.folder} failed. The compiler's last lines:\n{last}\n"
            "If a download failed, run the same command again: what is built stays built."
        )


def ensure(program: Program) -> Path:
    """The folder with the built program, which is built now unless the cache has it."""
    folder = sources() / program.folder
    finished = cache() / "bin" / key(program, folder)
    if finished.is_dir():
        return finished
    print(f"  building {program.folder} from its Go modules: {program.expect}", flush=True)
    began = time.monotonic()
    finished.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=".building-", dir=finished.parent))
    try:
        compile_into(program, folder, temporary)
        for name in program.links:
            (temporary / name).symlink_to(program.folder)
        temporary.chmod(0o755)
        try:
            temporary.rename(finished)
        except OSError:
            if not finished.is_dir():  # else someone else built the same meanwhile
                raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    print(f"  built {program.folder} in {time.monotonic() - began:.0f} s", flush=True)
    return finished


def module_of(program: Program) -> Path:
    """The folder of the sources of a program that is built from a published module."""
    done = subprocess.run(
        ["go", "list", "-f", "{{.Module.Dir}}", program.package],
        cwd=sources() / program.folder,
        capture_output=True,
        text=True,
        timeout=BUILD_SECONDS,
        check=False,
    )
    if done.returncode:
        raise ClusterError(f"The sources of {program.folder} can't be had:\n{done.stderr}")
    return Path(done.stdout.strip())


def binaries() -> Path:
    """A folder with all programs under their names; building what the cache has not."""
    folders = [ensure(program) for program in PROGRAMS]
    together = hashlib.sha256("\n".join(f.name for f in folders).encode()).hexdigest()[:16]
    finished = cache() / "bin" / f"cluster-{together}"
    if finished.is_dir():
        return finished
    temporary = Path(tempfile.mkdtemp(prefix=".linking-", dir=finished.parent))
    for folder in folders:
        for program in folder.iterdir():
            (temporary / program.name).symlink_to(f"../{folder.name}/{program.name}")
    temporary.chmod(0o755)
    try:
        temporary.rename(finished)
    except OSError:
        shutil.rmtree(temporary, ignore_errors=True)
        if not finished.is_dir():
            raise
    return finished
