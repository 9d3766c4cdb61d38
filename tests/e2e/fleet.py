"""A job of 200 small cases for tests of what may happen to it, and what must come out of it."""

import base64
import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.e2e import jobs
from tests.e2e import kubectl as k

CASES = 200
FOLDER = "fleet"
# One file in, one out that only this input can have, after a second in which a fault may strike.
PROGRAM = """
import hashlib, time
from bagpipe import binpipe
for record in binpipe.read():
    data = record.read()
    time.sleep(1.0)
    binpipe.write(hashlib.sha256(data).hexdigest().encode(), name="digest")
"""


def content(number: int) -> bytes:
    """What input file `number` holds."""
    return f"recorded bytes of drive {number}\n".encode() * (number + 1)


def put_files(namespace: str) -> None:
    """Write the input files into the claim `recordings`."""
    program = (
        f"import os; os.makedirs('/recordings/{FOLDER}', exist_ok=True)\n"
        f"for n in range({CASES}):\n"
        f"  text = b'recorded bytes of drive %d\\n' % n * (n + 1)\n"
        f"  open(f'/recordings/{FOLDER}/{{n:03d}}.bin', 'wb').write(text)\n"
    )
    encoded = base64.b64encode(program.encode()).decode()
    run = f"import base64; exec(base64.b64decode('{encoded}'))"
    k.in_toolbox(namespace, "python3", "-c", run)


def make_job(name: str, output: str = "pvc://results/fleet", **changed: Any) -> k.Object:
    """200 cases on three executors of four slots."""
    spec: k.Object = {
        "source": {"files": [f"pvc://recordings/{FOLDER}/*.bin"]},
        "stack": {
            "engine": "exec",
            "image": "bagpipe.local/spark:0.2.0",
            "command": ["python3", "-c", PROGRAM],
        },
        "playback": {"caseTimeout": "60s"},
        "spark": jobs.spark(3, 4),
        "output": {"uri": output},
    }
    return {
        "apiVersion": "sim.bagpipe.io/v1alpha1",
        "kind": "SimulationJob",
        "metadata": {"name": name},
        "spec": spec | changed,
    }


def expected() -> dict[str, str]:
    """The undisturbed result: case -> what its output holds."""
    return {f"{n:03d}": hashlib.sha256(content(n)).hexdigest() for n in range(CASES)}


def outputs(namespace: str, uri: str) -> dict[str, str]:
    """File name -> content of everything below a job's cases/."""
    folder = "/" + uri.removeprefix("pvc://") + "/cases"
    listed = k.in_toolbox(namespace, "sh", "-c", f"cd {folder} && grep -H '' *")
    return dict(line.split(":", 1) for line in listed.splitlines())


@dataclass(frozen=True)
class Left:
    """What a job left in the folder of its results; `kept` is file name -> content of cases/."""

    manifest: k.Object
    rows: list[k.Object]
    kept: dict[str, str]
    journal: list[str]


def left_on_claim(namespace: str, uri: str) -> Left:
    """Below a results URI on the claim `results`, by the toolbox."""
    manifest, rows = k.results(namespace, uri)
    folder = "/" + uri.removeprefix("pvc://")
    journal = k.in_toolbox(namespace, "sh", "-c", f"ls -A {folder}/journal").split()
    return Left(manifest, rows, outputs(namespace, uri), journal)


def left_in(folder: Path) -> Left:
    """In a folder of this machine, such as that of a volume which the toolbox hasn't mounted."""
    return Left(
        json.loads((folder / "manifest.json").read_text()),
        [json.loads(line) for line in (folder / "results.jsonl").read_text().splitlines()],
        {path.name: path.read_text() for path in (folder / "cases").iterdir()},
        [path.name for path in (folder / "journal").glob("*")],
    )


def journaled(namespace: str, uri: str) -> dict[str, str]:
    """Case -> the recorded name, of all that the journal has at this moment."""
    folder = "/" + uri.removeprefix("pvc://") + "/journal"
    program = (
        "import json, pathlib\n"
        f"for path in pathlib.Path('{folder}').glob('*.jsonl'):\n"
        "  for line in path.read_text().splitlines():\n"
        "    row = json.loads(line); print(row['case'], row['recorded'][0])\n"
    )
    output = k.in_toolbox(namespace, "python3", "-c", program)
    return dict(line.split() for line in output.splitlines())


def pods(namespace: str, job: str, role: str) -> list[k.Object]:
    """The job's pods of a role that run, by name."""
    selector = f"sim.bagpipe.io/job={job},sim.bagpipe.io/role={role}"
    found = k.items(namespace, "pods", "-l", selector)
    return [pod for pod in found if pod["status"].get("phase") == "Running"]


def container_id(pod: k.Object, name: str) -> str:
    """The runtime's id of a running container."""
    status = pod["status"]
    listed = [*status.get("initContainerStatuses", []), *status.get("containerStatuses", [])]
    found: str = next(each["containerID"] for each in listed if each["name"] == name)
    return found
