"""The image of the example nodes holds what the tests ran with."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[3]


def test_its_packages_are_those_of_the_tests() -> None:
    pins = (ROOT / "docs/examples/example-nodes/requirements.txt").read_text().split()
    locked = set(re.findall(r'name = "(\S+)"\nversion = "(\S+)"', (ROOT / "uv.lock").read_text()))
    assert pins
    assert {tuple(pin.split("==")) for pin in pins} <= locked
