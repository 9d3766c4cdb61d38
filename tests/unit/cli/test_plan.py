"""`bagpipe plan`: the cases of a job before anything runs."""

import hashlib
import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.cli.manifest import ManifestError, read_job, read_object
from tests.unit.bagpipe.bags import steady, write_bag

SPEC = {
    "source": {
        "bags": ["pvc://recordings/*.bag"],
        "topics": ["/scan"],
        "fragment": {"length": "3s"},
    },
    "stack": {"image": "i", "command": ["c"], "parameters": {"/t": "{{ threshold }}"}},
    "variants": [{"name": "released"}, {"name": "pr-812", "image": "j"}],
    "matrix": {
        "variables": {"threshold": [0.4, 0.6], "rain": ["off", "on"]},
        "exclude": [
            {"when": "threshold > 0.5 && rain == 'on'", "because": "never driven"},
        ],
    },
    "record": {"topics": ["/out"]},
    "output": {"uri": "pvc://results/out"},
}
HEAD = "apiVersion: sim.bagpipe.io/v1alpha1\nkind: SimulationJob\n"


def run(folder: Path, *arguments: str, **changed: object) -> tuple[int, str]:
    job = {
        "apiVersion": "sim.bagpipe.io/v1alpha1",
        "kind": "SimulationJob",
        "metadata": {"name": "lane"},
        "spec": SPEC | changed,
    }
    (folder / "job.yaml").write_text(yaml.safe_dump(job))
    ended = CliRunner().invoke(main, ["plan", str(folder / "job.yaml"), *arguments])
    return ended.exit_code, ended.output


def test_the_conditions_of_a_fragment_without_the_recordings(tmp_path: Path) -> None:
    status, text = run(tmp_path)
    assert status == 0
    assert "6 cases for each fragment. The recordings of recordings are not on this" in text
    assert "threshold > 0.5 && rain == 'on'" in text
    assert "never driven" in text
    assert "*-s2-pr-812" in text
    assert "*-s3-pr-812" not in text


def test_every_case_with_the_recordings(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 100, 50_000_000), chunk_bytes=1024)
    status, text = run(tmp_path, "--volume", f"recordings={tmp_path}", "--output", "json")
    assert status == 0
    made = json.loads(text)
    assert (made["fragments"], made["conditions"], len(made["cases"])) == (2, 6, 12)
    assert made["matrix"]["combinations"] == 4
    assert made["matrix"]["excluded"] == [
        {
            "values": {"threshold": 0.6, "rain": "on"},
            "when": "threshold > 0.5 && rain == 'on'",
            "because": "never driven",
        }
    ]
    first = made["cases"][0]
    assert first["case"] == "a-0000-s0-pr-812"
    assert first["values"] == {"threshold": 0.4, "rain": "off"}
    assert sum(c["messages"] for c in made["cases"]) == 600
    status, text = run(tmp_path, "--volume", f"recordings={tmp_path}")
    assert "12 cases: 2 fragments, each under 6 conditions." in text


def test_a_bag_that_yields_no_case_is_reported_and_ends_with_2(tmp_path: Path) -> None:
    (tmp_path / "cut.bag").write_bytes(b"#ROSBAG V2.0\n")
    status, text = run(tmp_path, "--volume", f"recordings={tmp_path}")
    assert status == 2
    assert "cut.bag" in text


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"matrix": {"variables": {"threshold": []}}}, "threshold has no value"),
        ({"matrix": {"variables": {"a": [1]}}}, "stack.parameters[/t] names {{ threshold }}"),
        ({"matrix": SPEC["matrix"] | {"exclude": ["speed > 1"]}}, "names speed"),  # type: ignore[operator]
        ({"record": None}, "record is missing"),
        ({"variants": [{"name": "a"}, {"name": "a"}]}, "two variants have one name"),
    ],
)
def test_what_can_t_be_planned_is_refused(
    tmp_path: Path, changed: dict[str, object], sentence: str
) -> None:
    status, text = run(tmp_path, **changed)
    assert status == 2
    assert sentence in text
    assert "Traceback" not in text


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"{", "is no YAML"),
        (b"\xff\xfe", "is no text (byte 0)"),
        (b"kind: ConfigMap\n", "holds 0 SimulationJobs, but ConfigMap: it"),
        (b"kind: A\n---\nkind: B\n---\nkind: A\n", "holds 0 SimulationJobs, but A and B: it must"),
        (b"a: 1\n---\n- 2\n", "holds 0 SimulationJobs, but what has no kind: it must"),
        (b"", "holds 0 SimulationJobs: it must hold one"),
        (f"{HEAD}---\n{HEAD}".encode(), "holds 2 SimulationJobs: it must hold one"),
        (b"kind: SimulationJob\n", "apiVersion is ''"),
        (f"{HEAD}metadata: my-job\n".encode(), "metadata is no map: write metadata: {name:"),
        (f"{HEAD}metadata: {{}}\n".encode(), "metadata.name is missing"),
    ],
)
def test_what_is_no_manifest_is_refused(tmp_path: Path, content: bytes, sentence: str) -> None:
    (tmp_path / "job.yaml").write_bytes(content)
    ended = CliRunner().invoke(main, ["plan", str(tmp_path / "job.yaml")])
    assert ended.exit_code == 2
    assert sentence in ended.output


def test_a_volume_that_is_no_folder_is_refused(tmp_path: Path) -> None:
    status, text = run(tmp_path, "--volume", "recordings=/nowhere")
    assert status == 2
    assert "write the claim's name, =, and a folder" in text


def test_help_teaches() -> None:
    text = CliRunner().invoke(main, ["plan", "--help"]).output
    assert "bagpipe plan job.yaml --volume recordings=/data/recordings" in text


def test_the_parts_of_a_sequence_are_shown(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 100, 50_000_000), chunk_bytes=1024)
    bag = "pvc://recordings/a.bag"
    pieces = [{"bag": bag, "from": "1s", "to": "2s"}, {"bag": bag, "to": "500ms", "times": 2}]
    changed = {"source": {"sequence": pieces, "topics": ["/scan"]}}
    status, text = run(tmp_path, "--volume", f"recordings={tmp_path}", **changed)
    assert status == 0
    assert "6 cases: 1 fragment, each under 6 conditions." in text
    shown = [line.split() for line in text.splitlines() if line.startswith(f" {bag}")]
    assert shown == [
        [bag, "2.000", "3.000", "2.000"],
        [bag, "1.000", "1.500", "3.000"],
        [bag, "1.000", "1.500", "3.500"],
    ]
    assert text.count("Parts of sequence-s0-pr-812") == 1


def test_what_looks_like_markup_is_shown_as_it_is(tmp_path: Path) -> None:
    values = ["[/front]", "[red]", "a[bold]b", "a:camera:b"]
    matrix = {
        "variables": {"mount": values},
        "exclude": [{"when": "mount == 'a[bold]b'", "because": "see [/wiki]"}],
    }
    status, text = run(tmp_path, matrix=matrix, stack={"image": "i", "command": ["c"]})
    assert status == 0
    for shown in ("[/front]", "[red]", "a:camera:b", "mount == 'a[bold]b'", "see [/wiki]"):
        assert shown in text


def test_a_terminal_obeys_no_name_of_a_recording(tmp_path: Path) -> None:
    (tmp_path / "a\x1b[2J.bag").write_bytes(b"x")
    write_bag(tmp_path / "b.bag", steady("/scan", 10, 50_000_000))
    rules = [{"cases": "x\x1b[2J", "reason": "r", "until": datetime.now(UTC).date().isoformat()}]
    status, text = run(tmp_path, "--volume", f"recordings={tmp_path}", quarantine=rules)
    assert (status, "a [2J.bag: the file begins with" in text) == (2, True)
    missing = run(tmp_path, "--volume", "recordings=/no\x1b[2J")
    assert (missing[0], "/no [2J: write the claim's name" in missing[1]) == (2, True)
    for shown in (text, missing[1]):
        assert [letter for letter in shown if not letter.isprintable() and letter != "\n"] == []


def test_a_pattern_that_no_bag_matches_is_named_as_it_is_written(tmp_path: Path) -> None:
    source = {"bags": ["pvc://recordings/run[ab]/*.bag"], "topics": ["/scan"]}
    status, text = run(tmp_path, "--volume", f"recordings={tmp_path}", source=source)
    assert (status, "run[ab]/*.bag" in text) == (2, True), text


def test_what_would_be_in_quarantine_is_shown_with_what_to_do_about_it(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 100, 50_000_000), chunk_bytes=1024)
    today = datetime.now(UTC).date()
    days = [(today + timedelta(days=n)).isoformat() for n in (20, -1, 91, 5)]
    names = ["a-0000-*", "a-0001-s0-pr-812", "*-released", "night-*"]
    rules = [
        {"cases": name, "reason": "issue 17", "until": day}
        for name, day in zip(names, days, strict=True)
    ]
    arguments = ("--volume", f"recordings={tmp_path}")
    status, text = run(tmp_path, *arguments, "--output", "json", quarantine=rules)
    assert status == 0
    found = json.loads(text)["quarantine"]
    assert [rule["named"] for rule in found["rules"]] == [6, 1, 6, 0]
    assert found["cases"] == 9
    lines = [rule["toDo"] for rule in found["rules"]]
    assert lines[:2] == ["", f"ended with {days[1]}: its cases count"]
    assert lines[2].startswith(f"spec.quarantine of '*-released' holds until {days[2]}")
    assert lines[3] == "names no case of this job: correct its pattern, or remove it"
    status, text = run(tmp_path, *arguments, quarantine=rules)
    assert "9 of them are in quarantine on" in text
    assert "quarantine of 'night-*': names no case of this job" in text


def test_a_day_needs_no_quotes_in_a_manifest(tmp_path: Path) -> None:
    rules = [{"cases": "*", "reason": "issue 17", "until": "DAY"}]
    run(tmp_path, quarantine=rules)
    manifest = tmp_path / "job.yaml"
    manifest.write_text(manifest.read_text().replace("DAY", "2026-12-31"))
    assert read_job(manifest)[1].quarantine[0].until.isoformat() == "2026-12-31"
    # As it goes to the API server, which takes texts only.
    assert json.loads(json.dumps(read_object(manifest)[0]))["spec"]["quarantine"] == [
        {"cases": "*", "reason": "issue 17", "until": "2026-12-31"}
    ]


def test_what_a_catalogue_selects_is_shown(tmp_path: Path) -> None:
    for name in ("wet", "dry"):
        write_bag(tmp_path / f"{name}.bag", steady("/scan", 60, 100_000_000))
    (tmp_path / "drives.csv").write_text("uri,weather\nwet.bag,rain\ndry.bag,sun\n")
    volume = ("--volume", f"recordings={tmp_path}")
    own = {"uri": "pvc://recordings/drives.csv", "where": "weather == 'rain'"}
    fields: dict[str, object] = {
        "source": {"catalogue": own, "topics": ["/scan"]}, "matrix": None, "variants": []
    }  # fmt: skip
    status, text = run(tmp_path, *volume, **fields)
    assert status == 0, text
    assert "1 case: 1 fragment" in text
    sha256 = hashlib.sha256((tmp_path / "drives.csv").read_bytes()).hexdigest()
    assert (
        "Selected: 1 recordings of 1 of 2 rows of pvc://recordings/drives.csv (sha256"
        f" {sha256[:12]}), where weather == 'rain'"
    ) in text
    status, text = run(tmp_path, *volume, "--output", "json", **fields)
    assert json.loads(text)["catalogue"]["sha256"] == sha256
    own["where"] = "weathr == 'rain'"
    status, text = run(tmp_path, *volume, **fields)
    assert status == 2
    assert "names weathr, which is no column of pvc://recordings/drives.csv" in text


def test_a_key_of_a_megabyte_is_refused_in_a_sentence_that_can_be_read(tmp_path: Path) -> None:
    """It stood three times in it."""
    name = "k" * 1_200_000
    manifest = tmp_path / "job.yaml"
    stack = {"image": "i", "command": ["c"], "parameters": {name: 1}}
    job = {
        "apiVersion": "sim.bagpipe.io/v1alpha1",
        "kind": "SimulationJob",
        "metadata": {"name": "lane"},
        "spec": SPEC | {"stack": stack},
    }
    manifest.write_text(yaml.safe_dump(job))
    with pytest.raises(ManifestError, match=r"spec\.stack\.parameters") as refused:
        read_job(manifest)
    lines = str(refused.value).split("\n")
    assert max(len(line) for line in lines) <= len(f"{manifest}") + 1_300
