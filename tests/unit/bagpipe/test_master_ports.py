"""No two runs on one machine take the same ports for their rosmasters."""

import errno
import random
import socket
import subprocess
import sys

import pytest

from bagpipe.run import master_ports as module
from bagpipe.run.master_ports import NoPortsError, master_ports

HOLDER = """
import sys
from bagpipe.run import master_ports as module
module.FIRST, module.END = map(int, sys.argv[1:])
module._in_turn = list
with module.master_ports(3) as first:
    print(first, flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def ranges(monkeypatch: pytest.MonkeyPatch) -> range:
    """Three ranges of this test's own, so that other runs on this machine are not in the way."""
    first = random.SystemRandom().randrange(31_400, 32_400)
    monkeypatch.setattr(module, "FIRST", first)
    monkeypatch.setattr(module, "END", first + 3 * module.STEP)
    monkeypatch.setattr(module, "_in_turn", list)
    return range(first, module.END, module.STEP)


def test_ports_are_given_to_one_at_a_time_and_back_afterwards(ranges: range) -> None:
    with master_ports(3) as one, master_ports(3) as two:
        assert [one, two] == [ranges[0], ranges[1]]
    with master_ports(3) as again:
        assert again == ranges[0]


def test_a_port_that_somebody_else_listens_on_is_left_to_them(ranges: range) -> None:
    with socket.create_server(("127.0.0.1", ranges[0] + 2)):
        with master_ports(3) as of_three:
            assert of_three == ranges[1]
        with master_ports(2) as of_two:
            assert of_two == ranges[0]


def test_another_process_holds_its_ports_until_it_ends(ranges: range) -> None:
    command = [sys.executable, "-c", HOLDER, str(ranges[0]), str(module.END)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert int(other.stdout.readline()) == ranges[0]
        with master_ports(3) as mine:
            assert mine == ranges[1]
        other.kill()
        other.wait(timeout=30)
    with master_ports(3) as mine:
        assert mine == ranges[0]


def test_another_process_begins_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.getpid", lambda: 7)
    assert module._in_turn([10, 20, 30]) == [20, 30, 10]


def test_where_names_are_not_to_be_had_free_ports_must_do(
    ranges: range, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = socket.socket

    class Denied(socket.socket):
        def bind(self, address: object) -> None:
            if self.family == socket.AF_UNIX:
                raise PermissionError(errno.EACCES, "denied")
            real.bind(self, address)  # type: ignore[arg-type]

    monkeypatch.setattr("bagpipe.run.master_ports.socket.socket", Denied)
    with master_ports(3) as first:
        assert first == ranges[0]


@pytest.mark.usefixtures("ranges")
def test_where_all_are_taken_it_says_so() -> None:
    with (
        master_ports(3), master_ports(3), master_ports(3),
        pytest.raises(NoPortsError, match="no 2 neighbouring ports are free for the rosmasters"),
        master_ports(2),
    ):  # fmt: skip
        pytest.fail("more ranges were given than there are")
