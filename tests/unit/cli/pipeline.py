"""The pipeline step of docs/tasks/ci-gate.md, run as a CI would run it."""

import os
import re
import subprocess
from pathlib import Path
from typing import Any

import yaml

PAGE = Path(__file__).parents[3] / "docs/tasks/ci-gate.md"
IMAGE = "registry.example/lane:pr-812"
SECONDS = 120


def step(
    folder: Path, job: dict[str, Any], namespace: str, program: str, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run it in a folder with this job.yaml; `program` is what a shell does for `bagpipe`."""
    (script,) = re.findall(r"```bash\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert "-n robots" in script
    job["spec"]["stack"]["image"] = "@IMAGE@"
    (folder / "job.yaml").write_text(yaml.safe_dump(job))
    (folder / "bin").mkdir()
    bagpipe = folder / "bin/bagpipe"
    bagpipe.write_text(f"#!/bin/sh\n{program}\n")
    bagpipe.chmod(0o755)
    return subprocess.run(
        ["bash", "-c", script.replace("-n robots", f"-n {namespace}")],
        cwd=folder,
        env={
            **os.environ,
            "PATH": f"{folder / 'bin'}:{os.environ['PATH']}",
            "IMAGE": IMAGE,
            **environment,
        },
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
