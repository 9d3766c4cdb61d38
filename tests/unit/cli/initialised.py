"""`bagpipe init` as tests call it: what it writes is judged by the CRD and the model each time."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.spec import SimulationJobSpec
from tests.unit.crds.offline import refusals

CRD = Path(__file__).parents[3] / "crds/simulationjobs.yaml"
# By libyaml: in Python it takes half a second of each process that collects these tests.
_READ = yaml.load(CRD.read_text(), Loader=yaml.CSafeLoader)
SCHEMA = _READ["spec"]["versions"][0]["schema"]["openAPIV3Schema"]
# What the API server adds to every schema.
SCHEMA["properties"] |= {name: {"type": "string"} for name in ("apiVersion", "kind")}
SCHEMA["properties"]["metadata"] = {"type": "object"}
SECOND = 1_000_000_000


@dataclass(frozen=True)
class Ended:
    """How the verb ended, and the job that it wrote."""

    status: int
    stdout: str
    stderr: str

    @property
    def spec(self) -> dict[str, Any]:
        found: dict[str, Any] = yaml.safe_load(self.stdout)["spec"]
        return found


def init(*words: str | Path) -> Ended:
    done = CliRunner().invoke(main, ["init", *map(str, words)])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    assert (done.stdout + done.stderr).isascii()
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f]", done.stdout + done.stderr)
    if done.exit_code == 0 and done.stdout.startswith("#"):
        job = yaml.safe_load(done.stdout)
        assert refusals(SCHEMA, job) == []
        SimulationJobSpec.model_validate(job["spec"])
    return Ended(done.exit_code, done.stdout, done.stderr)


def planned(tmp_path: Path, text_of: str, volume: Path) -> Any:
    (tmp_path / "job.yaml").write_text(text_of)
    words = ["plan", str(tmp_path / "job.yaml"), "--volume", f"recordings={volume}"]
    return CliRunner().invoke(main, words)
