"""Fragments crossed with the matrix, the variants and the rounds; each case's own stack."""

import dataclasses
from pathlib import Path

import pytest
from pydantic import JsonValue

from bagpipe.matrix.faults import MatrixError
from bagpipe.plan.conditions import Conditions, crossing
from bagpipe.plan.variant import check_templates, image_of, stack_of
from bagpipe.run.case_run import RunContext, case_map
from bagpipe.source.planning import plan
from bagpipe.spec import stack_images
from bagpipe.storage import Storage
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.jobs import make_spec

VARIANTS = [
    {"name": "released"},
    {"name": "pr-812", "image": "stack:2", "parameters": {"/b": 2}, "remap": {"/c": "/e"}},
    {"name": "tuned", "command": ["run", "--fast"], "env": [{"name": "A", "value": "3"}]},
]
STACK = {
    "image": "stack:1",
    "command": ["run", "--threshold={{ threshold }}"],
    "env": [{"name": "A", "value": "{{ rain }}"}, {"name": "B", "value": "{{ variant }}"}],
    "parameters": {"/a": "{{ threshold }}", "/b": 1},
    "remap": {"/c": "/d_{{ rain }}"},
}
MATRIX = {"variables": {"threshold": [0.4, 0.6], "rain": ["off", "on"]}, "exclude": ["rain == 'x'"]}


def test_every_case_once_and_a_name_that_says_which(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 100, 50_000_000), chunk_bytes=1024)
    spec = make_spec(
        source={
            "bags": ["pvc://recordings/a.bag"],
            "topics": ["/scan"],
            "fragment": {"length": "3s"},
        },
        stack=STACK,
        variants=VARIANTS[:2],
        matrix={"variables": {"threshold": [1, 2], "rain": ["on"]}, "seeds": 2},
        playback={"rounds": 2},
    )
    cases = plan(spec, Storage({"recordings": str(tmp_path)})).cases
    assert len(cases) == 2 * 2 * 2 * 2 * 2
    assert len({case.id for case in cases}) == 32
    of_first = [case.id for case in cases if case.fragment == "a-0000"]
    assert sorted(of_first)[:4] == [
        "a-0000-s0.0-pr-812-r0",
        "a-0000-s0.0-pr-812-r1",
        "a-0000-s0.0-released-r0",
        "a-0000-s0.0-released-r1",
    ]
    found = next(case for case in cases if case.id == "a-0001-s1.1-pr-812-r1")
    assert found.conditions == Conditions("pr-812", 1, {"threshold": 2, "rain": "on"}, 1, 1)


def test_the_stack_of_a_variant_under_a_scenario() -> None:
    spec = make_spec(stack=STACK, variants=VARIANTS, matrix=MATRIX)
    values: dict[str, JsonValue] = {"threshold": 0.6, "rain": "on"}
    released = stack_of(spec, Conditions("released", 3, values))
    assert released.command == ["run", "--threshold=0.6"]
    assert released.parameters == {"/a": 0.6, "/b": 1}
    assert released.remap == {"/c": "/d_on"}
    assert {e.name: e.value for e in released.env} == {"A": "on", "B": "released"}
    changed = stack_of(spec, Conditions("pr-812", 3, values))
    assert (changed.image, changed.parameters) == ("stack:2", {"/a": 0.6, "/b": 2})
    assert changed.remap == {"/c": "/e"}
    tuned = stack_of(spec, Conditions("tuned", 3, values))
    assert tuned.command == ["run", "--fast"]
    assert {e.name: e.value for e in tuned.env} == {"A": "3", "B": "tuned"}


def test_each_image_is_in_the_pod_once() -> None:
    spec = make_spec(variants=[*VARIANTS, {"name": "again", "image": "stack:2"}])
    assert stack_images(spec) == ["stack:1", "stack:2"]
    assert [image_of(spec, v) for v in ("released", "pr-812", "tuned", "again")] == [0, 1, 0, 1]
    assert stack_images(make_spec()) == ["stack:1"]
    every_variant_its_own = make_spec(variants=[{"name": "a", "image": "new:1"}])
    assert stack_images(every_variant_its_own) == ["new:1"]


def test_a_stack_without_matrix_and_variants_has_no_templates() -> None:
    spec = make_spec(stack=STACK)
    assert stack_of(spec, Conditions()) == spec.stack


@pytest.mark.parametrize(
    ("stack", "sentence"),
    [
        ({"command": ["run", "{{ speed }}"]}, "stack.command[1] names {{ speed }}"),
        ({"parameters": {"/a": ["{{ speed }}"]}}, "stack.parameters[/a] names"),
        ({"env": [{"name": "A", "value": "{{ speed }}"}]}, "stack.env[A] names"),
        ({"remap": {"/a": "/{{ speed }}"}}, "stack.remap[/a] names"),
    ],
)
def test_a_template_that_names_nothing_is_refused_before_anything_runs(
    stack: dict[str, object], sentence: str
) -> None:
    spec = make_spec(stack={"image": "stack:1", "command": ["run"]} | stack, matrix=MATRIX)
    with pytest.raises(MatrixError) as refused:
        check_templates(spec)
    assert sentence in str(refused.value)
    assert "rain, seed, threshold, variant" in str(refused.value)


def test_two_variants_of_one_name_are_refused() -> None:
    with pytest.raises(ValueError, match="two variants have one name"):
        make_spec(variants=[{"name": "a"}, {"name": "a"}])


def test_a_case_s_stack_reaches_the_agent(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 100, 50_000_000), chunk_bytes=1024)
    spec = make_spec(
        source={"bags": ["pvc://recordings/a.bag"], "topics": ["/scan"]},
        stack=STACK,
        variants=VARIANTS,
        matrix=MATRIX,
    )
    cases = plan(spec, Storage({"recordings": str(tmp_path)})).cases
    tuned = next(case for case in cases if case.id == "a-0000-s3-tuned")
    described = case_map(tuned, RunContext("lab/drive", spec, {}, "pvc://results/out"))
    assert described["stack"] == {
        "command": ["run", "--fast"],
        "environment": {"A": "3", "B": "tuned"},
        "parameters": {"/a": 0.6, "/b": 1},
        "remap": {"/c": "/d_on"},
        "master": "agent",
        "player": "auto",
        "active": [],
        "flow_control": True,
        "qos": {},
    }
    assert dataclasses.asdict(tuned.conditions)["values"] == {"threshold": 0.6, "rain": "on"}


def test_conditions_without_a_matrix_are_one() -> None:
    [(name, conditions)] = crossing(make_spec()).named
    assert (name, conditions) == ("", Conditions())
    assert conditions == Conditions(variant="", scenario=None, values={}, seed=0, round=0)


def names_of(**changed: object) -> list[str]:
    return [name for name, _ in crossing(make_spec(**changed)).named]


@pytest.mark.parametrize(
    ("values", "included", "first", "last"),
    [
        (1, 0, "-s0", "-s0"),
        (10, 0, "-s0", "-s9"),
        (11, 0, "-s00", "-s10"),
        (9, 1, "-s0", "-s9"),
        (10, 1, "-s00", "-s10"),
    ],
)
def test_names_of_scenarios_are_as_wide_as_the_last_one_s(
    values: int, included: int, first: str, last: str
) -> None:
    matrix = {
        "variables": {"n": list(range(values))},
        "include": [{"n": values + more} for more in range(included)],
    }
    names = names_of(matrix=matrix)
    assert (len(names), names[0], names[-1]) == (values + included, first, last)


@pytest.mark.parametrize(
    ("seeds", "first", "last"),
    [(2, "-s0.0", "-s0.1"), (10, "-s0.0", "-s0.9"), (11, "-s0.00", "-s0.10")],
)
def test_names_of_seeds_are_as_wide_as_the_last_one_s(seeds: int, first: str, last: str) -> None:
    names = names_of(matrix={"variables": {"n": [1]}, "seeds": seeds})
    assert (len(names), names[0], names[-1]) == (seeds, first, last)
    assert names == sorted(names)


@pytest.mark.parametrize(
    ("rounds", "names"),
    [
        (1, [""]),
        (2, ["-r0", "-r1"]),
        (10, [f"-r{n}" for n in range(10)]),
        (11, [f"-r{n:02d}" for n in range(11)]),
    ],
)
def test_rounds_are_numbered_from_0_where_there_are_several(rounds: int, names: list[str]) -> None:
    assert names_of(playback={"rounds": rounds}) == names


def test_of_each_scenario_every_variant_comes_before_the_next_one() -> None:
    """A job that is stopped early has compared its variants on what it ran."""
    found = crossing(
        make_spec(
            variants=VARIANTS[:2], matrix={"variables": {"n": [7, 8]}}, playback={"rounds": 2}
        )
    )
    assert [(name, c.variant, c.values["n"], c.round) for name, c in found.named] == [
        ("-s0-released-r0", "released", 7, 0),
        ("-s0-released-r1", "released", 7, 1),
        ("-s0-pr-812-r0", "pr-812", 7, 0),
        ("-s0-pr-812-r1", "pr-812", 7, 1),
        ("-s1-released-r0", "released", 8, 0),
        ("-s1-released-r1", "released", 8, 1),
        ("-s1-pr-812-r0", "pr-812", 8, 0),
        ("-s1-pr-812-r1", "pr-812", 8, 1),
    ]
    assert found.expansion is not None
    assert crossing(make_spec()).expansion is None


def test_templates_may_name_values_the_seed_and_the_variant() -> None:
    assert Conditions("a", 3, {"n": 7}, 2, 1).known == {"n": 7, "seed": 2, "variant": "a"}
