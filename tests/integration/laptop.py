"""`bagpipe run` as people start it on their own machine, with all that it starts."""

import os
import subprocess
import sys
import threading
import time
import uuid
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

ROS_PATH = "/usr/lib/robot_state_publisher:/usr/bin:/bin"
RUN_SECONDS = 500
# A local Spark starts in 5 s on an idle machine, and in a minute on a busy one.
STEP_SECONDS = 200
MARK = "BAGPIPE_TEST_OF_RUN"


@dataclass
class Laptop:
    """A folder with manifests, recordings and results, and the program on this machine."""

    folder: Path
    agent: Path
    volumes: dict[str, str] = field(default_factory=dict)
    mark: str = field(default_factory=lambda: uuid.uuid4().hex)

    def manifest(self, name: str, spec: dict[str, Any]) -> Path:
        """A manifest in a file of its own."""
        job = {"apiVersion": "sim.bagpipe.io/v1alpha1", "kind": "SimulationJob"}
        path = self.folder / f"{name}.yaml"
        path.write_text(yaml.safe_dump(job | {"metadata": {"name": name}, "spec": spec}))
        return path

    def start(self, *words: str | Path) -> "subprocess.Popen[str]":
        """The program, in this folder, with Debian's ROS on its PATH."""
        # A run that is killed can't remove its folder for temporary files.
        scratch = self.folder / "tmp"
        scratch.mkdir(exist_ok=True)
        environment = os.environ | {"PATH": ROS_PATH, "TMPDIR": str(scratch), MARK: self.mark}
        if "--spark" not in words:
            environment["JAVA_HOME"] = "/nowhere"
        return subprocess.Popen(
            [sys.executable, "-m", "bagpipe.cli", *map(str, words)],
            cwd=self.folder,
            env=environment,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )

    def run(self, *words: str | Path) -> tuple[int, str, str]:
        """Status, stdout and stderr of the program."""
        process = self.start(*words)
        try:
            output, errors = process.communicate(timeout=RUN_SECONDS)
        finally:
            process.kill()
        print(errors)
        return process.returncode, output, errors

    def job(self, manifest: Path, *words: str | Path) -> tuple[int, str, str]:
        """`bagpipe run` of a manifest, whose recordings lie here."""
        return self.run(*self.words(manifest), *words)

    def words(self, manifest: Path) -> list[str | Path]:
        """What `bagpipe run` is given in any case."""
        volume = ["--volume", f"recordings={self.folder / 'recordings'}"]
        return ["run", manifest, *volume, "--agent", self.agent]

    def left_over(self) -> list[str]:
        """The command lines of all processes that a run has started and that still are there."""
        found = []
        for process in Path("/proc").glob("[0-9]*"):
            try:
                environment = (process / "environ").read_bytes()
                line = (process / "cmdline").read_bytes().replace(b"\0", b" ").decode()
            except OSError:
                continue
            if f"{MARK}={self.mark}".encode() in environment and line:
                found.append(line)
        return found

    def await_nothing_left(self) -> None:
        """Until all that was started is gone: Spark's workers notice its end a moment later."""
        deadline, pause = time.monotonic() + STEP_SECONDS, threading.Event()
        while left := self.left_over():
            assert time.monotonic() < deadline, left
            pause.wait(0.1)
