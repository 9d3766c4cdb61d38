"""What a session of mutants says: which were killed, and which are shown."""

import json
import tomllib
from pathlib import Path

from tests.mutation import run


def line(outcome: str | None, test: str | None, diff: str = "") -> str:
    result = outcome and {"worker_outcome": outcome, "test_outcome": test, "diff": diff}
    return json.dumps([{"job_id": "x"}, result])


def test_survivors_are_shown_and_what_was_left_out_counts_for_nothing() -> None:
    dump = [
        line("normal", "killed", "-a\n+b"),
        line("normal", "survived", "-c\n+d"),
        line("skipped", None),
        line("normal", "incompetent"),
        line("normal", "survived", "-@dataclass(frozen=True)\n+@dataclass(frozen=False)\n"),
        line(None, None),
    ]
    assert run.judged(dump) == (2, ["-c\n+d"])


def test_a_hundred_percent_is_all_of_them() -> None:
    assert run.share(199, 1) == "99 %"
    assert run.share(200, 0) == "100 %"
    assert run.share(0, 0) == "0 %"


def test_the_tests_of_a_module_s_name_come_first_and_all_that_import_it_come() -> None:
    found = run.nearest(Path("operator/src/bagpipe_operator/jobs/status.py"))
    named = ["tests/unit/operator/test_status.py", "tests/unit/operator/test_status_by_hand.py"]
    assert sorted(found[:2]) == named
    assert "tests/unit/operator/test_cold_start.py" in found[2:]
    assert not [test for test in found if "/unit/compare/" in test]


def test_the_configuration_is_toml() -> None:
    read = tomllib.loads(run.configuration("a/b.py", 'pytest -k "c d"'))
    assert read["cosmic-ray"]["module-path"] == "a/b.py"
    assert read["cosmic-ray"]["test-command"] == 'pytest -k "c d"'
    assert read["cosmic-ray"]["filters"]["operators-filter"]["exclude-operators"] == run.LEFT_OUT


def test_each_decider_and_each_of_its_tests_is_there() -> None:
    for file, tests in run.deciders().items():
        assert (run.ROOT / file).is_file(), file
        assert tests
        for test in tests:
            path, _, name = test.partition("::")
            assert (run.ROOT / path).is_file(), test
            assert not name or f"def {name}(" in (run.ROOT / path).read_text(), test


def test_enough_is_eighty_five_percent() -> None:
    assert run.enough(17, 3)
    assert not run.enough(169, 30)  # 84.9 %
    assert not run.enough(0, 0)
