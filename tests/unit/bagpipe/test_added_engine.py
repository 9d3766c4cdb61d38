"""An engine is one folder: tests/toy_engine on Python's path, of which nothing else knows."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import yaml

from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.jobs import make_job

ROOT = Path(__file__).parents[3]
TOY = ROOT / "tests/toy_engine"
SECOND = 1_000_000_000
SPEC = {
    "source": {"bags": ["pvc://recordings/*.bag"], "fragment": {"length": "4s"}},
    "stack": {"engine": "loopback", "image": "any", "command": ["cat"]},
    "record": {"topics": ["/out"]},
    "output": {"uri": "pvc://results/r"},
}
DERIVED = """
import json, sys
sys.path.insert(0, "crds")
from generate import derived
print(json.dumps({str(path): text for path, text in derived().items()}))
"""
REFUSED = """
import json, sys
from pydantic import ValidationError
from bagpipe.spec import SimulationJobSpec
try:
    SimulationJobSpec.model_validate(json.loads(sys.argv[1]))
except ValidationError as error:
    print(error.errors()[0]["msg"])
"""
COUNTED = """
import json, sys
from bagpipe.driver.metrics import DriverMetrics
from bagpipe.driver.progress import Progress
from tests.unit.bagpipe.jobs import make_job, make_row
job = make_job({}, **json.loads(sys.argv[1]))
metrics = DriverMetrics(Progress("pvc://results/r", slots=1), job)
for reason in ("BytesMissing", "BytesMissing", "TicksMissing"):
    metrics.count(make_row("a", "failed", reason))
counted = lambda reason: metrics.registry.get_sample_value(
    "bagpipe_case_faults_total", {"reason": reason}
)
print(json.dumps([counted(reason) for reason in ("BytesMissing", "TicksMissing", "Other")]))
"""
UNMARKED = """
from bagpipe.cli.cluster.case_lines import of_case
print(of_case("[slot 1 case a] starting", "a", "stack", "loopback"))
"""

# Modules `fields` and `engine` of engines that can't be used, and why.
DECLARES = (TOY / "bagpipe_engines/loopback/fields.py").read_text()
BROKEN = {
    "bare": ({}, "fields", "ModuleNotFoundError: No module named 'bagpipe_engines.bare.fields'"),
    "empty": ({"fields": ""}, "fields", "AttributeError: module 'bagpipe_engines.empty.fields'"),
    "needy": ({"fields": "import ros2"}, "fields", "ModuleNotFoundError: No module named 'ros2'"),
    "raising": ({"fields": "1 / 0"}, "fields", "ZeroDivisionError: division by zero"),
    "half": ({"fields": DECLARES}, "engine", "ModuleNotFoundError: No module named 'bagpipe_engin"),
}
LOADED = """
import json
from bagpipe.engine.chosen import engine_of
from bagpipe.engine_fields import engine_names, fields_of
from bagpipe.installed import InstallationError
stated = {}
for name in engine_names():
    try:
        fields_of(name), engine_of(name)
    except InstallationError as error:
        stated[name] = str(error), type(error.__cause__).__name__
print(json.dumps(stated))
"""
OPERATOR = "from bagpipe_operator.main import main; main()"


def python(*words: str, path: tuple[Path, ...] = (TOY,)) -> "subprocess.CompletedProcess[str]":
    """Python with folders on its path besides ours."""
    places = [*map(str, path), str(ROOT / "images/spark/src"), str(ROOT / "operator/src")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(places)}
    return subprocess.run(
        [sys.executable, *words], cwd=ROOT, env=environment, capture_output=True, text=True,
        timeout=120, check=False,
    )  # fmt: skip


def refusal(changed: dict[str, Any], *, path: tuple[Path, ...] = (TOY,)) -> str:
    done = python("-c", REFUSED, json.dumps(SPEC | changed), path=path)
    assert done.returncode == 0, done.stderr
    return done.stdout.removeprefix("Value error, ").strip()


def manifest(folder: Path, stack: object = SPEC["stack"]) -> Path:
    """A job's file."""
    job = {"apiVersion": "sim.bagpipe.io/v1alpha1", "kind": "SimulationJob"}
    file = folder / "job.yaml"
    spec = SPEC | {"stack": stack}
    file.write_text(yaml.safe_dump(job | {"metadata": {"name": "toy"}, "spec": spec}))
    return file


def test_the_crd_gets_its_name_and_nothing_else() -> None:
    done = python("-c", DERIVED)
    assert done.returncode == 0, done.stderr
    derived = json.loads(done.stdout)
    jobs = derived.pop(str(ROOT / "crds/simulationjobs.yaml"))
    committed = (ROOT / "crds/simulationjobs.yaml").read_text()
    assert jobs != committed
    assert jobs.replace("[ros1, exec, loopback, ros2]", "[ros1, exec, ros2]") == committed
    for path, text in derived.items():
        added = set(text.splitlines()) - set(Path(path).read_text().splitlines())
        assert len(added) <= 1, path
        assert all("loopback" in line for line in added), path


def test_its_spec_is_accepted_and_what_it_declares_meaningless_is_refused() -> None:
    assert refusal({}) == ""
    criterion = {"name": "some", "presence": {"topic": "/out", "min": 1}}
    assert refusal({"evaluate": [criterion]}).startswith("evaluate has no meaning with stack.engi")
    assert refusal({"playback": {"mode": "max"}}).startswith("playback.mode and rate have no mean")
    assert refusal({"record": None}).startswith("record is missing: write for example")
    assert refusal({"source": {"files": ["pvc://a/b"]}}) == (
        "source.files need stack.engine: exec: write source.bags"
    )


def test_an_engine_that_is_not_there_is_refused_with_those_that_are() -> None:
    unknown = {"stack": SPEC["stack"] | {"engine": "ros3"}}  # type: ignore[operator]
    here = "stack.engine is {}, and the engines here are {}: write one of them"
    assert refusal(unknown) == here.format("'ros3'", "ros1, exec, loopback, ros2")
    assert refusal({}, path=()) == here.format("'loopback'", "ros1, exec, ros2")


def test_two_engines_of_one_name_are_refused(tmp_path: Path) -> None:
    second = tmp_path / "bagpipe_engines/exec"
    second.mkdir(parents=True)
    (second / "__init__.py").touch()
    done = python("-c", REFUSED, json.dumps(SPEC), path=(TOY, tmp_path))
    assert "bagpipe.engine.exec and bagpipe_engines.exec are engines of one name" in done.stderr


def broken(folder: Path, *names: str) -> Path:
    """A place on Python's path with these engines."""
    for name in names:
        place = folder / "bagpipe_engines" / name
        place.mkdir(parents=True)
        for module, text in {"__init__": "", **BROKEN[name][0]}.items():
            (place / f"{module}.py").write_text(text)
    return folder


def test_an_engine_that_can_t_be_loaded_is_named_with_the_cause(tmp_path: Path) -> None:
    done = python("-c", LOADED, path=(TOY, broken(tmp_path, *BROKEN)))
    assert done.returncode == 0, done.stderr
    stated = json.loads(done.stdout)
    assert stated.keys() == BROKEN.keys()
    for name, (_, module, cause) in BROKEN.items():
        sentence, raised_from = stated[name]
        start = f"the engine's module bagpipe_engines.{name}.{module} can't be loaded ({cause}"
        assert sentence.startswith(start)
        assert sentence.endswith("): install the engine as a whole, or remove its folder")
        assert raised_from == cause.partition(":")[0]


def test_an_engine_that_can_t_be_loaded_is_a_sentence_of_each_program(tmp_path: Path) -> None:
    path = (TOY, broken(tmp_path, "needy"))
    stack = {"engine": "needy", "image": "any", "command": ["cat"]}
    plan = python("-m", "bagpipe.cli", "plan", str(manifest(tmp_path, stack)), path=path)
    assert (plan.returncode, plan.stdout) == (2, "")
    assert plan.stderr.startswith("Error: the engine's module bagpipe_engines.needy.fields can't")
    operator = python("-c", OPERATOR, path=path)
    assert operator.returncode == 1
    assert operator.stderr.startswith("bagpipe-operator: the engine's module bagpipe_engines.needy")
    written = make_job({}).model_dump(mode="json", by_alias=True)
    written["spec"]["stack"]["engine"] = "needy"
    job = tmp_path / "job.json"
    job.write_text(json.dumps(written))
    driver = python("-m", "bagpipe.driver", "--job", str(job), path=path)
    assert driver.returncode == 1
    assert driver.stderr.startswith("bagpipe.driver: the engine's module bagpipe_engines.needy")
    texts = (plan.stderr, operator.stderr, driver.stderr)
    assert [text.count("\n") for text in texts] == [1, 1, 1]


def test_its_cases_are_planned(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 80, SECOND // 10))
    volume = ("--volume", f"recordings={tmp_path}")
    job = str(manifest(tmp_path))
    done = python("-m", "bagpipe.cli", "plan", job, *volume, "--output", "json")
    assert done.returncode == 0, done.stderr
    assert '"a-0001"' in done.stdout


def test_its_own_reasons_are_counted_by_name() -> None:
    done = python("-c", COUNTED, json.dumps(SPEC))
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == [2.0, None, 1.0]
    usual = {"stack": SPEC["stack"] | {"engine": "ros1"}}  # type: ignore[operator]
    done = python("-c", COUNTED, json.dumps(SPEC | usual))
    assert json.loads(done.stdout) == [None, None, 3.0]


def test_its_log_s_unmarked_lines_are_whose_it_says() -> None:
    assert python("-c", UNMARKED).stdout == "['starting']\n"
