"""What goes into each image: the build contexts, staged outside the checkout.

A context holds exactly what its Dockerfile copies, so an image's content is decided by its
context, its Dockerfile and its base, and a hash over them says whether it has to be built.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import emulation
from claim import claim
from cross import Target, environment
from failure import BuildError
from lock import locked

ROOT = Path(__file__).resolve().parents[2]
REGISTRY = "bagpipe.local"
VERSION = (ROOT / "VERSION").read_text().strip()
BASE = "docker.io/library/debian:bookworm-20251103-slim"
CARGO_SECONDS = 1800.0
WHEEL_SECONDS = 120.0
# Debian 12 has glibc 2.36: maturin refuses a module that asks for more than this names.
WHEEL = "manylinux_2_34"
# Layers are reused when files are the same to the second, and a copy has a time of its own.
EPOCH = 1_700_000_000


def cache() -> Path:
    """The folder of everything that is worth keeping between builds and checkouts."""
    return Path(os.environ.get("BAGPIPE_CACHE") or Path.home() / ".cache" / "bagpipe")


def tool(name: str) -> str:
    """A program out of the checkout's virtual environment, else the machine's."""
    own = ROOT / ".venv" / "bin" / name
    found = str(own) if own.exists() else shutil.which(name)
    if not found:
        raise BuildError(f"There is no {name} in .venv or on PATH; run `make venv` first.")
    return found


def requirements(package: str, target: Path, *extras: str) -> None:
    """Write the pinned dependencies of a package, as uv.lock has them, with their hashes."""
    _export(target, "--no-dev", "--package", package, *(f"--extra={extra}" for extra in extras))


def builders(target: Path) -> None:
    """Write what makes wheels out of sources, as uv.lock has it, with hashes."""
    _export(target, "--only-group", "build")


def _export(target: Path, *chosen: str) -> None:
    command = [tool("uv"), "export", "--frozen", "--no-emit-workspace", "--no-header", *chosen]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise BuildError(f"`{' '.join(command[1:])}` failed: {done.stderr.strip()}")
    target.write_text(done.stdout)


def package(source: Path, folder: Path) -> None:
    """Build a Python package's wheel into a folder; the same sources give the same bytes.

    By the virtual environment's hatchling, which is in uv.lock: inside of an image, or by `uv
    build`, another one would be fetched for it.
    """
    command = [tool("hatchling"), "build", "--target", "wheel", "--directory", str(folder)]
    done = subprocess.run(
        command,
        cwd=source,
        env={**os.environ, "SOURCE_DATE_EPOCH": str(EPOCH)},
        capture_output=True,
        text=True,
        timeout=WHEEL_SECONDS,
        check=False,
    )
    if done.returncode:
        raise BuildError(f"hatchling could not build {source.name}: {done.stderr.strip()}")


def cargo_folder(target: Target | None = None) -> Path:
    """Where cargo builds for this machine, or for a target of another architecture."""
    return cache() / (f"cargo-{target.arch}" if target else "cargo")


def compile_rust(
    what: str,
    command: list[str],
    target: Target | None = None,
    last: Sequence[str] = (),
    **settings: str,
) -> None:
    """Run cargo or maturin on the workspace, which is quick when nothing changed.

    With a target it compiles for that architecture, else for this machine. What comes last in the
    command is rustc's.
    """
    # Where cargo leaves what it builds, and for which machines, is not the user's to choose here.
    inherited = {name: value for name, value in os.environ.items() if name != "CARGO_BUILD_TARGET"}
    crossed = environment(target, cache()) if target else {}
    folder = cargo_folder(target)
    # One at a time, whatever for: each takes all processors.
    with locked(cache() / "cargo.lock", CARGO_SECONDS):
        claim(folder)
        done = subprocess.run(
            [*command, *(["--target", target.triple] if target else []), *last],
            cwd=ROOT / "images" / "agent",
            env={**inherited, "CARGO_TARGET_DIR": str(folder), **crossed, **settings},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            timeout=CARGO_SECONDS,
            check=False,
        )
    if done.returncode:
        last = "\n".join(done.stderr.splitlines()[-30:])
        raise BuildError(f"cargo could not build {what} in images/agent. Its last lines:\n{last}")


def agent_binary(target: Target | None = None) -> Path:
    """Build the static agent with the machine's cargo, for this machine or for another target."""
    # Only the last crate is built as static, so bagpipe.MemoryBag can share the others.
    command = ["cargo", "rustc", "--locked", "--release", "--package", "bagpipe-agent"]
    static = ["--", "-C", "target-feature=+crt-static"]
    compile_rust("the agent", command, target, static, RUSTFLAGS="")
    folder = cargo_folder(target)
    return (folder / target.triple if target else folder) / "release" / "bagpipe-agent"


def memory_bag(folder: Path, target: Target | None = None) -> Path:
    """Build bagpipe.MemoryBag's module as a wheel in a folder; the same sources give the same
    bytes. It is for this machine, or for another target.
    """
    command = [tool("maturin"), "build", "--locked", "--release", "--compatibility", WHEEL]
    command += ["--manifest-path", "crates/python/Cargo.toml", "--out", str(folder)]
    # maturin moves what cargo made: a second one at the same time would miss it.
    with locked(cache() / "memory-bag.lock", CARGO_SECONDS):
        compile_rust("bagpipe.MemoryBag", command, target)
    return one_wheel(folder)


def one_wheel(folder: Path) -> Path:
    wheels = list(folder.glob("bagpipe_bag-*.whl"))
    if len(wheels) != 1:
        raise BuildError(f"maturin left {len(wheels)} wheels in {folder}, and one was expected.")
    return wheels[0]


def stage_agent(folder: Path, target: Target | None = None) -> None:
    shutil.copy(agent_binary(target), folder / "bagpipe-agent")


def stage_spark(folder: Path, target: Target | None = None) -> None:
    requirements("bagpipe", folder / "requirements.txt", "spark", "storage")
    builders(folder / "build-requirements.txt")
    package(ROOT / "images" / "spark", folder / "packages")
    memory_bag(folder / "packages", target)
    for name in ("entrypoint.sh", "class_archive.py"):
        shutil.copy(ROOT / "images" / "spark" / name, folder)


def stage_operator(folder: Path) -> None:
    requirements("bagpipe-operator", folder / "requirements.txt")
    package(ROOT / "images" / "spark", folder / "packages")
    package(ROOT / "operator", folder / "packages")


def stage_exec_highway(folder: Path) -> None:
    for name in ("requirements.txt", "simulate.py", "frames.py"):
        shutil.copy(ROOT / "docs" / "examples" / "exec-highway" / name, folder)


# The nodes of the example stacks, and what they share with the examples of BinPipedRDDs.
EXAMPLE_NODES = [
    "binpipe/clustering.py",
    "binpipe/walking.py",
    "localisation/ekf.py",
    "localisation/localise.py",
    "obstacles-node/obstacles_node.py",
    "pedestrians-node/pedestrians_node.py",
]


def stage_example_nodes(folder: Path) -> None:
    examples = ROOT / "docs" / "examples"
    shutil.copy(examples / "example-nodes" / "requirements.txt", folder)
    (folder / "nodes").mkdir()
    for name in EXAMPLE_NODES:
        shutil.copy(examples / name, folder / "nodes")


def stage_barrier_car(folder: Path) -> None:
    for name in ("planner.py", "dusk.py"):
        shutil.copy(ROOT / "docs" / "examples" / "barrier-car" / name, folder)


def stage_ros2_standin(folder: Path) -> None:
    sources = ROOT / "tests" / "ros2"
    beside = shutil.ignore_patterns("Dockerfile", "fastdds")
    shutil.copytree(sources, folder / "sources", ignore=beside)


def stage_ros2_rclpy(folder: Path) -> None:
    shutil.copy(ROOT / "tests" / "ros2_rclpy" / "wheels.txt", folder)
    shutil.copy(ROOT / "tests" / "ros2_real" / "nodes" / "scripts" / "answering.py", folder)


def stage_nothing(_folder: Path) -> None:
    """Some images are all in their Dockerfile."""


@dataclass(frozen=True)
class Image:
    """An image of ours: where its Dockerfile is and what the Dockerfile copies."""

    name: str
    dockerfile: Path
    stage: Callable[[Path], None]
    base: str = BASE
    # Of another machine than this one: it is in no cluster here, and goes into releases.
    target: Target | None = None

    @property
    def key(self) -> str:
        """What its files in the cache are called."""
        return f"{self.name}-{self.target.arch}" if self.target else self.name

    @property
    def reference(self) -> str:
        return f"{REGISTRY}/{self.name}:{VERSION}" + (f"-{self.target.arch}" if self.target else "")


IMAGES = [
    Image("agent", ROOT / "images/agent/Dockerfile", stage_agent, base="scratch"),
    Image("operator", ROOT / "images/operator/Dockerfile", stage_operator),
    Image("spark", ROOT / "images/spark/Dockerfile", stage_spark),
    Image("ros", ROOT / "images/ros/Dockerfile", stage_nothing),
    Image(
        "robot-state-publisher",
        ROOT / "docs/examples/robot-state-publisher/Dockerfile",
        stage_nothing,
    ),
    Image("barrier-car", ROOT / "docs/examples/barrier-car/Dockerfile", stage_barrier_car),
    Image("exec-highway", ROOT / "docs/examples/exec-highway/Dockerfile", stage_exec_highway),
    Image("ros2-standin", ROOT / "tests/ros2/Dockerfile", stage_ros2_standin),
    Image("ros2-rclpy", ROOT / "tests/ros2_rclpy/Dockerfile", stage_ros2_rclpy),
    Image("example-nodes", ROOT / "docs/examples/example-nodes/Dockerfile", stage_example_nodes),
]


# What a cluster needs, and what stages the parts that are compiled for its machines.
FOREIGN: dict[str, Callable[..., None] | None] = {
    "agent": stage_agent,
    "operator": None,
    "spark": stage_spark,
}


def foreign(target: Target) -> list[Image]:
    """The images that can be built here for another architecture.

    The agent is all made by cargo; the others run programs of their own architecture while they
    are built, which have to be emulated.
    """
    return [
        replace(image, stage=partial(stage, target=target) if stage else image.stage, target=target)
        for name, stage in FOREIGN.items()
        for image in IMAGES
        if image.name == name and (image.base == "scratch" or not unemulated(target))
    ]


def unemulated(target: Target) -> str:
    """Why images with a base can't be built for a target here, and the cure; else nothing."""
    if not shutil.which("buildah"):
        return "there is no buildah: run `make preflight`"
    return emulation.lacking(target.machine)


def stage(image: Image) -> Path:
    """Make an image's context again and return its folder."""
    folder = cache() / "images" / "contexts" / image.key
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    image.stage(folder)
    shutil.copy(image.dockerfile, folder / "Dockerfile")
    for path in [folder, *folder.rglob("*")]:
        path.chmod(0o755 if path.is_dir() or os.access(path, os.X_OK) else 0o644)
        os.utime(path, (EPOCH, EPOCH))
    return folder


def content(image: Image, folder: Path, base: str) -> str:
    """A hash over all that decides what the image holds; `base` is the base's identity."""
    digest = hashlib.sha256(f"{image.reference} {base}\n".encode())
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        data = path.read_bytes()
        name = path.relative_to(folder)
        executable = os.access(path, os.X_OK) and path.stat().st_mode & 0o100
        digest.update(f"{name} {bool(executable)} {len(data)}\n".encode() + data)
    return digest.hexdigest()
