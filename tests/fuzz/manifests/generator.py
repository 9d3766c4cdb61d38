"""Manifests, made of the documentation's own examples with one to three places changed.

The places are those of the CRD's schema, each in its turn; the values are mostly valid, so that
admission lets many manifests through. Everything follows from the seed.
"""

import copy
import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache

import yaml

from tests.fuzz.manifests import schema as schemas
from tests.fuzz.manifests import values
from tests.fuzz.manifests.schema import ANY_KEY, EACH, ROOT, Place, Schema
from tests.fuzz.manifests.values import Json

JOB = "SimulationJob"
SCHEDULE = "SimulationSchedule"
API_VERSION = "sim.bagpipe.io/v1alpha1"

# What is done to a place, with how often. `lax`: for a CRD that lets everything through.
_TAME = {"valid": 20, "hostile": 3, "remove": 1, "wrong": 1, "null": 1, "unknown": 1}
_LAX = {"valid": 3, "hostile": 6, "remove": 3, "wrong": 6, "null": 2, "unknown": 1}
# What a running job lets be changed, so that not all edits are refused for one reason.
_EDITABLE = ("suspend", "activeDeadline", "startDeadline", "ttlAfterFinished")


@dataclass(frozen=True)
class Mutation:
    """One change: what was done, and where."""

    what: str
    place: Place


@dataclass(frozen=True)
class Manifest:
    """An object to be written, and how it differs from an example."""

    kind: str
    object: Json
    mutations: tuple[Mutation, ...] = ()


@cache
def examples() -> dict[str, list[Json]]:
    """The documentation's jobs and schedules by kind; not to be changed."""
    found: dict[str, list[Json]] = {JOB: [], SCHEDULE: []}
    for path in sorted((ROOT / "docs/examples").glob("**/*.yaml")):
        for each in yaml.safe_load_all(path.read_text()):
            if each and each.get("kind") in found:
                found[each["kind"]].append(each)
    return found


@dataclass
class Generator:
    """A stream of manifests and statuses; two of one seed make the same."""

    rng: random.Random
    lax: bool = False
    _examples: dict[str, list[Json]] = field(default_factory=examples)
    _turns: dict[tuple[str, str], Iterator[Place]] = field(default_factory=dict)
    _made: int = 0

    def manifest(self, kind: str = "") -> Manifest:
        """The next manifest; of any kind, jobs more often, unless one is asked for."""
        kind = kind or self.rng.choices((JOB, SCHEDULE), (3, 1))[0]
        made = copy.deepcopy(self.rng.choice(self._examples[kind]))
        self._made += 1
        made["metadata"] = {"name": f"f{self._made}"}
        done = self._mutate(kind, "spec", made, self.rng.choice((1, 1, 2, 3)))
        if self.rng.random() < (0.3 if self.lax else 0.08):
            self._spoil_metadata(made["metadata"])
        return Manifest(kind, made, done)

    def edit(self, kind: str, whole: Json) -> Json:
        """A living object with one place changed; its metadata stays."""
        edited = copy.deepcopy(whole)
        if kind == JOB and self.rng.random() < 0.6:
            name = self.rng.choice(_EDITABLE)
            inner = schemas.whole(kind)["properties"]["spec"]["properties"][name]
            hostile = self.rng.random() < (0.6 if self.lax else 0.2)
            edited["spec"][name] = (
                values.hostile(self.rng, schemas.type_of(inner), name)
                if hostile
                else schemas.valid(self.rng, inner)
            )
            return edited
        self._mutate(kind, "spec", edited, 1)
        return edited

    def status(self, kind: str) -> Json:
        """A status as somebody with the right to write it would forge it."""
        root = schemas.whole(kind)["properties"]["status"]
        made: Json = {"kind": kind, "status": _rich(self.rng, root)}
        self._mutate(kind, "status", made, self.rng.choice((0, 1, 2, 3)))
        return made["status"]

    def _mutate(self, kind: str, part: str, whole: Json, count: int) -> tuple[Mutation, ...]:
        done = []
        for _ in range(count):
            known = self.rng.random() < 0.5 and self._known_place(kind, part, whole)
            place = known or self._next_place(kind, part)
            weights = _LAX if self.lax else _TAME
            what = self.rng.choices(list(weights), list(weights.values()))[0]
            root = schemas.whole(kind)["properties"][part]
            self._change(whole, part, root, place, what)
            done.append(Mutation(what, place))
        return tuple(done)

    def _next_place(self, kind: str, part: str) -> Place:
        """Every place of the schema once, in some order, before any comes again."""
        turn = self._turns.get((kind, part))
        place = next(turn, None) if turn is not None else None
        if place is None:
            everywhere = list(schemas.places_of(kind, part))
            self.rng.shuffle(everywhere)
            turn = self._turns[kind, part] = iter(everywhere)
            place = next(turn)
        return place

    def _known_place(self, kind: str, part: str, whole: Json) -> Place | None:
        """A place that the manifest has already."""
        value, inner = whole[part], schemas.whole(kind)["properties"][part]
        steps: list[str] = []
        while value and isinstance(value, dict | list) and (not steps or self.rng.random() < 0.95):
            index = self.rng.choice([*value] if isinstance(value, dict) else range(len(value)))
            step = EACH if isinstance(value, list) else str(index)
            below = schemas.child(inner, step)
            if below is None:
                break
            known = step == EACH or step in (inner.get("properties") or {})
            steps.append(step if known else ANY_KEY)
            value, inner = value[index], below
        return Place(tuple(steps), schemas.type_of(inner)) if steps else None

    def _donated(self, kind: str, part: str, place: Place) -> Json:
        """What some example has in that place; None where none has anything."""
        found: list[Json] = [example.get(part) for example in self._examples[kind]]
        for step in place.steps:
            inner = [_inside(value, step) for value in found]
            found = [value for values_ in inner for value in values_]
        return copy.deepcopy(self.rng.choice(found)) if found else None

    def _change(self, whole: Json, part: str, root: Schema, place: Place, what: str) -> None:
        """Does one thing to one place, making what leads there where it is not."""
        holder, key, inner = whole, part, root
        for step in place.steps:
            below = schemas.child(inner, step) or {}
            holder, key = self._into(holder, key, inner, step)
            inner = below
        if what == "remove":
            del holder[key]
        elif what == "unknown":
            holder[key] = self._with_unknown(_get(holder, key))
        elif what == "null":
            holder[key] = None
        elif what == "valid":
            donated = self._donated(str(whole.get("kind")), part, place)
            made = schemas.valid(self.rng, inner)
            holder[key] = made if donated is None or self.rng.random() < 0.3 else donated
        else:
            make = values.hostile if what == "hostile" else values.wrong
            holder[key] = make(self.rng, place.type, place.field)

    def _into(self, holder: Json, key: Json, schema: Schema, step: str) -> tuple[Json, Json]:
        """The container behind a key, and the key in it that the step means."""
        wanted: type = list if step == EACH else dict
        if not isinstance(_get(holder, key), wanted):
            made = schemas.valid(self.rng, schema)
            holder[key] = made if isinstance(made, wanted) else wanted()
        inner = holder[key]
        if step == EACH:
            if not inner:
                inner.append(None)
            return inner, self.rng.randrange(len(inner))
        if step == ANY_KEY:
            step = self.rng.choice([*inner, "a", self.rng.choice(values.WORDS)])
        inner.setdefault(step, None)
        return inner, step

    def _with_unknown(self, value: Json) -> Json:
        if isinstance(value, dict):
            return value | {self.rng.choice(values.TEXTS): values.tree(self.rng)}
        return {"unknown": value}

    def _spoil_metadata(self, meta: Json) -> None:
        """Odd names, labels and annotations, and an owner that is none."""
        match self.rng.randrange(5):
            case 0:
                meta["name"] = self.rng.choice(values.NAMES)
            case 1:
                meta["labels"] = self.rng.choice(values.LABELS)
            case 2:
                meta["annotations"] = self.rng.choice(values.ANNOTATIONS)
            case 3:
                meta["ownerReferences"] = [
                    {
                        "apiVersion": API_VERSION, "kind": SCHEDULE, "name": "nightly",
                        "uid": "uid-of-nightly", "controller": True,
                    }
                ]  # fmt: skip
                meta["labels"] = values.LABELS[0]
            case _:
                meta["finalizers"] = ["example.com/kept"]


def seeded(seed: int | str, lax: bool = False) -> Generator:
    """A generator whose every manifest follows from the seed."""
    return Generator(random.Random(seed), lax)


def _get(holder: Json, key: Json) -> Json:
    return holder.get(key) if isinstance(holder, dict) else holder[key]


def _inside(value: Json, step: str) -> list[Json]:
    """The values one step below a value."""
    if step == EACH:
        return list(value) if isinstance(value, list) else []
    if not isinstance(value, dict):
        return []
    return list(value.values()) if step == ANY_KEY else [value[step]] if step in value else []


def _rich(rng: random.Random, schema: Schema) -> Json:
    """An object with about half of its fields, and with conditions where it may have them."""
    made = {
        name: schemas.valid(rng, inner)
        for name, inner in schema["properties"].items()
        if rng.random() < 0.5
    }
    if "conditions" in schema["properties"]:
        types = ["Accepted", "Planned", "Running", "Complete", "Failed", "Suspended", "Passed"]
        types += ["Ready", "OnTime", "Stalled"]
        made["conditions"] = [
            schemas.valid(rng, schema["properties"]["conditions"]["items"])
            | {"type": type_, "reason": rng.choice(_REASONS)}
            for type_ in rng.sample(types, rng.randrange(5))
        ]
    return made


_REASONS = ("JobResumed", "Suspending", "DriverLost", "StartDeadlineExceeded", "InProgress", "x")
