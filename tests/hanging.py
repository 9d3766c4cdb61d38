"""A program of the exec engine that hangs in its case `a-hangs`, and starts what hangs with it.

Three families, each a session of its own whose members ignore what asks them to end, and of each a
daemon in a further session. The program itself does not end by itself either. Its other case,
`b-goes-well`, says that it began and waits for the signal to go on, so that a test can look.
"""

# A number that no other process has among its arguments, and the program only as a sum.
SLEEP = 98765
SLEEPERS = 6
# What their input files hold: the larger one is planned first.
CASES = {"a-hangs": "larger than the other", "b-goes-well": "small"}
_PROGRAM = """
import pathlib, signal, subprocess, time
from bagpipe import binpipe
folder = pathlib.Path(FOLDER)
for record in binpipe.read():
    record.read()
    if record.name == "a-hangs.bin":
        # What is ignored stays so in all that is started.
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        sleep = f"sleep {98760 + 5}"
        for _ in range(3):
            family = ["sh", "-c", f"setsid {sleep} & {sleep}; :"]
            subprocess.Popen(family, start_new_session=True)
        time.sleep(10000)
    (folder / "next-began").touch()
    while not (folder / "go-on").exists():
        time.sleep(0.1)
    binpipe.write(b"went well", name="answer")
"""


def program(folder: str) -> str:
    """Its source; `folder` is where its marks are."""
    return _PROGRAM.replace("FOLDER", repr(folder))


def is_sleeper(command_line: str) -> bool:
    """Whether a process (its arguments, by spaces) is one that the program started."""
    return command_line.strip().endswith(f"sleep {SLEEP}")
