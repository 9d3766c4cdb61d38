"""What an installation leaves behind."""

import os
from pathlib import Path

from embedded.preflight import services_held


def test_no_service_is_started_by_an_installation(tmp_path: Path) -> None:
    policy = tmp_path / "policy-rc.d"
    with services_held(policy):
        assert policy.read_text().endswith("exit 101\n")
        assert os.access(policy, os.X_OK)
    assert not policy.exists()


def test_a_policy_of_the_machines_own_stays(tmp_path: Path) -> None:
    policy = tmp_path / "policy-rc.d"
    policy.write_text("#!/bin/sh\nexit 0\n")
    with services_held(policy):
        assert policy.read_text().endswith("exit 0\n")
    assert policy.exists()
