"""What of a job this machine can't give, found before anything runs, each with what to do."""

import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from bagpipe.engine.chosen import engine_of
from bagpipe.engine.engine import Program
from bagpipe.matrix.faults import MatrixError
from bagpipe.plan.conditions import crossing
from bagpipe.plan.variant import stack_of
from bagpipe.spec import ComparisonRules, FoundBaseline, SimulationJobSpec, Stack, Variant

# What a stack's image may bring to set up its environment; the agent starts commands by it.
_ENTRYPOINT = Path("/ros_entrypoint.sh")
# Fields that only a cluster can keep, as a manifest writes them.
_WITHOUT_EFFECT = {
    "suspend": "suspend",
    "managed_by": "managedBy",
    "queue_name": "queueName",
    "start_deadline": "startDeadline",
    "active_deadline": "activeDeadline",
    "ttl_after_finished": "ttlAfterFinished",
    "backoff_limit": "backoffLimit",
}
_OF_THE_STACK = {"resources": "resources", "security_context": "securityContext"}


@dataclass(frozen=True)
class Machine:
    """This machine as a stack's processes see it: their environment, and the entrypoint."""

    environment: Mapping[str, str]
    entrypoint: Path = _ENTRYPOINT

    def has(self, program: Program, own: Mapping[str, str]) -> bool:
        """Whether a stack finds it that has these variables of its own beside the machine's."""
        environment = {**self.environment, **own}
        if self.entrypoint.exists():
            return True
        if program.found is not None:
            return program.found(environment)
        return shutil.which(program.name, path=environment.get("PATH", os.defpath)) is not None


def of_variants(spec: SimulationJobSpec, names: tuple[str, ...]) -> SimulationJobSpec:
    """The job with these of its variants alone. Raises MatrixError for one that it has not."""
    have = [variant.name for variant in spec.variants]
    for name in names:
        if name not in have:
            raise MatrixError(
                f"--variant {name}: the job's variants are {', '.join(have) or 'none'}"
            )
    kept = [variant for variant in spec.variants if not names or variant.name in names]
    return spec.model_copy(update={"variants": kept})


def without_missing(spec: SimulationJobSpec) -> SimulationJobSpec:
    """The job whose comparison misses no case: those that were not asked for are not run."""
    allow = [*spec.comparison.allow, "Missing"]
    return spec.model_copy(update={"comparison": ComparisonRules(allow=sorted(set(allow)))})


def refusals(
    spec: SimulationJobSpec, volumes: Mapping[str, str], machine: Machine
) -> Iterator[str]:
    """A sentence for each thing without which the job can't run here. Raises MatrixError."""
    for claim in missing_claims(spec, volumes):
        yield (
            f"the claim {claim} is not on this machine: give --volume {claim}=FOLDER, with the"
            " folder that has the recordings as the claim has them"
        )
    if spec.resume_from is not None:
        yield (
            "spec.resumeFrom names a job of a cluster, which is not asked here: leave it out;"
            " an interrupted run goes on with --resume"
        )
    for criterion in spec.evaluate:
        if criterion.own is not None:
            yield (
                f"evaluate[{criterion.name}] is a program in the ConfigMap"
                f" {criterion.own.config_map} of a cluster: leave this criterion out here, or"
                " submit the job"
            )
    yield from _of_the_environment(spec, machine)
    yield from _of_the_programs(spec, machine)
    yield from _of_the_variants(spec)


def without_schedule(
    spec: SimulationJobSpec,
) -> tuple[SimulationJobSpec, FoundBaseline | None]:
    """The job without a baseline that only a cluster has, and what results say of that."""
    if spec.baseline is None or spec.baseline.last_passed is None:
        return spec, None
    schedule = spec.baseline.last_passed.removeprefix("schedule/")
    message = (
        f"nothing is compared: spec.baseline.lastPassed names the schedule {schedule} of a cluster,"
        " which is not asked here (baseline.results, or bagpipe compare, takes any results)"
    )
    found = FoundBaseline(schedule=schedule, message=message)
    return spec.model_copy(update={"baseline": None}), found


def missing_claims(spec: SimulationJobSpec, volumes: Mapping[str, str]) -> list[str]:
    """The claims that are read and have no folder; the output's own is not among them."""
    read = spec.source.uris + ([spec.compared_with] if spec.compared_with else [])
    used = {uri.removeprefix("pvc://").split("/", 1)[0] for uri in read if uri.startswith("pvc://")}
    return sorted(used - set(volumes))


def notes(spec: SimulationJobSpec, folder: Path) -> Iterator[str]:
    """What is otherwise here than on a cluster, as sentences. Raises MatrixError."""
    yield (
        "images are not used here: the stack's command runs as a process of this machine, with"
        " your rights and without limits"
    )
    for word in _files_named(spec):
        if not Path(word).exists():
            yield f"stack.command names {word}, which is not on this machine"
    for source in spec.stack.env_from:
        named = source.secret_ref or source.config_map_ref
        yield (
            f"stack.envFrom names {named.name if named else 'an object'} of a cluster: what the"
            " stack needs of it must be in your environment"
        )
    if spec.storage.secrets:
        yield "storage.secrets are of a cluster: storage's credentials come from your environment"
    ignored = [f"spec.{name}" for key, name in _WITHOUT_EFFECT.items() if key in _given(spec)]
    ignored += [f"spec.stack.{n}" for key, n in _OF_THE_STACK.items() if key in _given(spec.stack)]
    if ignored:
        yield f"without effect here: {', '.join(ignored)}"
    yield f"the results go to {folder}, not to {spec.output.uri}"


def _of_the_environment(spec: SimulationJobSpec, machine: Machine) -> Iterator[str]:
    for variable in spec.stack.env:
        found = variable.value_from
        if found is None or variable.name in machine.environment:
            continue
        key = found.secret_key_ref or found.config_map_key_ref
        if key is None or not key.optional:
            yield (
                f"stack.env[{variable.name}] has its value from a cluster: set"
                f" {variable.name} in your environment"
            )
    for mount in spec.stack.volume_mounts:
        if not Path(mount.mount_path).exists():
            yield (
                f"stack.volumeMounts has {mount.mount_path}, which is not on this machine: make a"
                " folder or a link of that name, or leave the mount out"
            )


def _of_the_programs(spec: SimulationJobSpec, machine: Machine) -> Iterator[str]:
    reported: set[tuple[str, str]] = set()
    for stack in _stacks(spec):
        own = {v.name: v.value for v in stack.env if v.value}
        for program in engine_of(stack.engine).programs(stack):
            missing = (program.name, own.get("PATH", ""))
            if missing not in reported and not machine.has(program, own):
                reported.add(missing)
                yield (
                    f"{program.why} {program.name}, which is not found here: {program.remedy}, or"
                    " run this inside of the stack's image"
                )


def _of_the_variants(spec: SimulationJobSpec) -> Iterator[str]:
    """Variants that differ in nothing but what is not used here would be found equal."""
    seen: dict[str, Variant] = {}
    for variant in spec.variants:
        same = variant.model_copy(update={"name": "", "image": ""}).model_dump_json()
        if same in seen and variant.image != seen[same].image:
            yield (
                f"the variants {seen[same].name} and {variant.name} differ in their images alone,"
                " which are not used here: run one of them where its programs are, with --variant"
                f" {variant.name}"
            )
        seen.setdefault(same, variant)


def _files_named(spec: SimulationJobSpec) -> list[str]:
    """The words after a command's first that begin with a slash and are no topic of the job.

    Remaps of ROS (/a:=/b) and QoS by topic have a colon or an equals sign, files seldom.
    """
    words = {word for stack in _stacks(spec) for word in stack.command[1:]}
    answers = {topic for step in spec.playback.steps for topic in (step.trigger, step.answer)}
    recorded = spec.record.topics if spec.record else ()
    names = {name for pair in spec.stack.remap.items() for name in pair}
    topics = {*(spec.source.topics or ()), *recorded, *answers, *names}
    return sorted(
        word for word in words - topics if word.startswith("/") and not set(":=") & set(word)
    )


def _stacks(spec: SimulationJobSpec) -> list[Stack]:
    """The stacks that cases start, with their templates filled; each command and PATH once."""
    found: dict[str, Stack] = {}
    for _, conditions in crossing(spec).named:
        stack = stack_of(spec, conditions)
        path = next((v.value for v in stack.env if v.name == "PATH"), "")
        found.setdefault("\0".join([*stack.command, path]), stack)
    return list(found.values())


def _given(model: SimulationJobSpec | Stack) -> set[str]:
    return model.model_fields_set
