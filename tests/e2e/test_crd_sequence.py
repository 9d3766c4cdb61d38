"""What source.sequence takes, as the API server says it."""

from typing import Any

import pytest

from tests.e2e.test_crd_refusals import (
    GOOD,
    Manifest,
    crd,  # noqa: F401  the fixture sees to the CRD in this module too
    dry_run,
)

pytestmark = pytest.mark.e2e

BAG = "pvc://recordings/drive.bag"


def job(*pieces: dict[str, Any], **spec: Any) -> Manifest:
    return GOOD | {"spec": GOOD["spec"] | {"source": {"sequence": list(pieces)}} | spec}


REFUSED: dict[str, tuple[list[dict[str, Any]], str]] = {
    "no piece": ([], "source.sequence must have at least one piece: write for example [{bag:"),
    "no bag": ([{"from": "1s"}], "sequence[0].bag: Required"),
    "no scheme": ([{"bag": "/drive.bag"}], "this bag's URI has no known scheme"),
    "a credential": ([{"bag": "s3://key:secret@data/a.bag"}], "must hold no credential"),
    "outside its volume": ([{"bag": "pvc://a/../b.bag"}], "must stay in its volume"),
    "several bags": ([{"bag": "pvc://a/*.bag"}], "a piece is of one bag: write its name"),
    "no unit": ([{"bag": BAG, "from": "10"}], "an offset is a duration with its unit: write"),
    "ends before its start": (
        [{"bag": BAG, "from": "10s", "to": "9.5s"}], "a piece must end behind its start: write a",
    ),
    "empty": ([{"bag": BAG, "to": "0s"}], "a piece must end behind its start"),
    "never": ([{"bag": BAG, "times": 0}], "should be greater than or equal to 1"),
    "an unknown field": ([{"bag": BAG, "until": "3s"}], 'unknown field "spec.source.sequence[0]'),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_makes_no_sequence_is_refused(case: str) -> None:
    pieces, sentence = REFUSED[case]
    answer = dry_run(job(*pieces))
    assert answer.returncode == 1, answer.stdout
    assert sentence in answer.stderr


def test_results_over_a_piece_are_refused() -> None:
    answer = dry_run(job({"bag": BAG}, output={"uri": f"{BAG}/results"}))
    assert answer.returncode == 1
    assert "a bag of source.sequence and would overwrite the recording" in answer.stderr


def test_a_sequence_and_bags_are_refused() -> None:
    both = {"sequence": [{"bag": BAG}], "bags": [BAG]}
    answer = dry_run(GOOD | {"spec": GOOD["spec"] | {"source": both}})
    assert answer.returncode == 1
    assert "source needs one of bags, sequence, files and simulator" in answer.stderr


def test_pieces_with_and_without_offsets_and_templates_are_taken() -> None:
    pieces: list[dict[str, Any]] = [
        {"bag": BAG},
        {"bag": BAG, "from": "1m30s", "to": "2m", "times": 3, "pause": "100ms"},
        {"bag": "s3://fleet/{{ scene }}.bag", "from": "{{ start }}s", "to": "{{ end }}s"},
    ]
    answer = dry_run(job(*pieces))
    assert answer.returncode == 0, answer.stderr
