"""What this machine has for the verbs that run here. Deciders are pure; `seen` looks."""

import importlib.util
import os
import re
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from bagpipe.cli.health.finding import Finding
from bagpipe.engine.chosen import engine_of
from bagpipe.engine_fields import engine_names, fields_of
from bagpipe.native import NativeModuleError, native
from bagpipe.quantities import memory_bytes
from bagpipe.run.laptop import agent_program, own_environment
from bagpipe.spec import SimulationJobSpec, Stack

_JAVA = re.compile(r'version "(?:1\.)?([0-9]+)')
_LEAST_JAVA = 17
_JAVA_SECONDS = 10.0
# Of a case whose job says nothing: the agent, the bag, a small stack and a worker.
_CASE_BYTES = 1 << 30
_WORKER_BYTES = 256 << 20
_MEMINFO = Path("/proc/meminfo")
_CGROUP = Path("/sys/fs/cgroup/memory.max")


@dataclass(frozen=True)
class Seen:
    """What is here: bytes, versions and paths; None and empty for what is not.

    `native` is the sentence that the native module is missing. `middleware` has where each engine's
    own is, empty if it is nowhere.
    """

    kubectl: str | None
    native: str
    agent: str | None
    java: int | None
    pyspark: bool
    memory: int | None
    processors: int
    middleware: dict[str, str]


def seen(agent: str) -> Seen:
    """A look at this machine."""
    environment = own_environment()
    return Seen(
        shutil.which("kubectl"),
        _native(),
        agent_program(agent),
        _java(environment),
        importlib.util.find_spec("pyspark") is not None,
        memory_here(),
        len(os.sched_getaffinity(0)),
        {name: _middleware(name, environment) for name in _with_middleware()},
    )


def _with_middleware() -> list[str]:
    return [name for name in engine_names() if fields_of(name).example]


def _middleware(name: str, environment: Mapping[str, str]) -> str:
    """Where an engine's middleware is."""
    stack = Stack(image="none", command=["none"], engine=name)
    there = []
    for program in engine_of(name).programs(stack):
        if program.name == stack.command[0]:
            continue
        if program.found is None:
            there.append(shutil.which(program.name, path=environment.get("PATH", os.defpath)) or "")
        else:
            there.append("its libraries" if program.found(environment) else "")
    return ", ".join(there) if all(there) else ""


def of_machine(found: Seen, spec: SimulationJobSpec | None, wanted: str) -> Iterator[Finding]:
    """The findings; `wanted` is submit, run or spark, and what it needs not is optional."""
    here, spark = wanted != "submit", wanted == "spark"
    remedy = "install it: messages and pages name its commands"
    yield _of("kubectl", found.kubectl or "", remedy, optional=True)
    yield Finding(
        "machine", "native module", "missing" if found.native else "done",
        "reads recordings, for plan, init, run and bag" if not found.native else "it is not here",
        found.native, optional=not here,
    )  # fmt: skip
    remedy = "`make wheels` in a checkout builds it; or give --agent"
    yield _of("bagpipe-agent", found.agent or "", remedy, optional=not here)
    yield from _of_ros(found, spec, here)
    yield _of_memory(found, spec, here)
    yield _of_java(found, spark)
    pyspark = "it is installed" if found.pyspark else ""
    remedy = "install bagpipe with its extra spark, or leave run --spark out"
    yield _of("PySpark", pyspark, remedy, optional=not spark)


def _of(what: str, found: str, remedy: str, optional: bool) -> Finding:
    if found:
        return Finding("machine", what, "done", found, optional=optional)
    return Finding("machine", what, "missing", "it is not here", remedy, optional)


def _of_ros(found: Seen, spec: SimulationJobSpec | None, here: bool) -> Iterator[Finding]:
    engine = spec.stack.engine if spec is not None else None
    there = found.middleware
    if engine is not None and engine not in there:
        return
    for name in there if engine is None else [engine]:
        # Without a job one of the two is enough.
        other = engine is None and any(there.values())
        remedy = "source its setup.bash, or run this inside of the stack's image"
        example = fields_of(name).example
        what = example.middleware if example else name
        yield _of(what, there[name], remedy, optional=not here or other)


def _of_memory(found: Seen, spec: SimulationJobSpec | None, here: bool) -> Finding:
    what = "memory"
    if found.memory is None:
        return Finding("machine", what, "unknown", "this system does not say it", optional=not here)
    slots = 1
    case = _CASE_BYTES
    if spec is not None:
        slots = min(spec.spark.most_slots, found.processors)
        limit = (spec.stack.resources.limits or {}).get("memory")
        if limit is not None:
            # The limit is a container's, which runs an executor's slots.
            case = memory_bytes(str(limit)) // spec.spark.slots
    needed = slots * (case + _WORKER_BYTES)
    text = f"{_gib(found.memory)} are free; {slots} slots may take {_gib(needed)}"
    if needed > found.memory:
        remedy = "run --slots with fewer, or shorter fragments"
        return Finding("machine", what, "missing", text, remedy, optional=not here)
    return Finding("machine", what, "done", text, optional=not here)


def _of_java(found: Seen, spark: bool) -> Finding:
    remedy = f"install a JRE of {_LEAST_JAVA} or newer, or leave run --spark out"
    if found.java is not None and found.java < _LEAST_JAVA:
        text = f"it is {found.java}, and Spark needs {_LEAST_JAVA}"
        return Finding("machine", "Java", "missing", text, remedy, optional=not spark)
    return _of("Java", "" if found.java is None else str(found.java), remedy, optional=not spark)


def _gib(count: int) -> str:
    return f"{count / 2**30:.3g} GiB"


def java_version(text: str) -> int | None:
    """The first number of what `java -version` writes; of 1.8 it is 8."""
    found = _JAVA.search(text)
    return int(found[1]) if found else None


def free_memory(meminfo: str, limit: str) -> int | None:
    """Bytes that may be taken: what /proc/meminfo has free, and no more than a cgroup's limit."""
    found = re.search(r"^MemAvailable:\s+([0-9]+) kB$", meminfo, re.MULTILINE)
    free = int(found[1]) << 10 if found else None
    bound = int(limit) if limit.strip().isdigit() else None
    known = [each for each in (free, bound) if each is not None]
    return min(known) if known else None


def memory_here() -> int | None:
    """The same of this machine."""
    texts = []
    for path in (_MEMINFO, _CGROUP):
        try:
            texts.append(path.read_text())
        except OSError:
            texts.append("")
    return free_memory(*texts)


def _native() -> str:
    try:
        native("TailError", "reading a bag")
    except NativeModuleError as error:
        return str(error)
    return ""


def _java(environment: Mapping[str, str]) -> int | None:
    home = environment.get("JAVA_HOME")
    program = shutil.which("java", path=f"{home}/bin" if home else environment.get("PATH"))
    if program is None:
        return None
    try:
        done = subprocess.run(
            [program, "-version"], capture_output=True, text=True, timeout=_JAVA_SECONDS,
            check=False, stdin=subprocess.DEVNULL,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired, UnicodeDecodeError):
        return None
    return java_version(done.stderr)
