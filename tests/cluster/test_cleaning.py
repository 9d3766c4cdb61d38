"""What `down` may take away, and what it must leave."""

import json
from pathlib import Path

import pytest
from embedded import cleaning


def loopback(sandbox: Path) -> str:
    return json.dumps({"result": {"interfaces": [{"name": "lo", "sandbox": str(sandbox)}]}})


def test_the_namespaces_of_a_cni_result(tmp_path: Path) -> None:
    assert cleaning.sandboxes(loopback(tmp_path / "cni-1")) == [tmp_path / "cni-1"]


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"result": {"interfaces": [{}]}}'])
def test_a_result_that_says_nothing_names_no_namespace(text: str) -> None:
    assert cleaning.sandboxes(text) == []
