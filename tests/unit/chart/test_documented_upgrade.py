"""What the documentation says of upgrades is whole: both CRDs, the namespace, and every value."""

import re
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs"


def test_whoever_keeps_the_crds_by_hand_sees_each() -> None:
    text = (DOCS / "operations/upgrade.md").read_text()
    commands = [line for line in text.splitlines() if line.startswith("    ")]
    applied, labelled, annotated = (
        [c for c in commands if f"kubectl {verb}" in c] for verb in ("apply", "label", "annotate")
    )
    for file in sorted((ROOT / "crds").glob("*.yaml")):
        name = yaml.safe_load(file.read_text())["metadata"]["name"]
        assert any(f"-f crds/{file.name}" in command for command in applied), file.name
        assert any(name in command for command in labelled), name
        assert any(name in command for command in annotated), name


def test_upgrades_name_the_release_s_namespace_and_take_values_that_are_new() -> None:
    """With --reuse-values a value of the newer chart is missing, and its schema wants it."""
    commands = [
        (page.relative_to(DOCS), command)
        for page in DOCS.rglob("*.md")
        for command in re.findall(
            r"helm upgrade (?:--install )?bagpipe [^`]*?(?<!\\)\n", page.read_text()
        )
    ]
    assert len(commands) >= 5
    for page, command in commands:
        assert re.search(r"(-n|--namespace) bagpipe-system", command), page
        assert "--reuse-values" not in command, page
