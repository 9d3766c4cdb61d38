"""Programs of the exec engine that lie, or look as if they did: programs.py WHICH.

Each is given a file with a number and is to give back its square, in `square.txt`.
"""

import math
import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from frames import FILE, RESULT, Answer, msgpack, read_files

PASSED = {"outcome": "passed"}


class Program:
    """Reads its file, gives back the square, says passed, ends with 0."""

    def __init__(self) -> None:
        self.stream, sys.stdout = sys.stdout.buffer, sys.stderr
        self.answer = Answer(self.stream)

    def run(self) -> None:
        number = self.read()
        self.answer.file("square.txt", str(number * number).encode())
        self.answer.end(dict(PASSED))

    def read(self) -> int:
        """The number of the file; from here on it has run."""
        ((_, data),) = read_files(sys.stdin.buffer)
        return int(data)


class Leaves(Program):
    """Gives all, says passed, and ends with another status than 0."""

    def run(self) -> None:
        super().run()
        print("can't free the model", file=sys.stderr, flush=True)
        os._exit(3)


class Segfault(Program):
    """Gives all, says passed, and dies."""

    def run(self) -> None:
        super().run()
        signal.signal(signal.SIGSEGV, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGSEGV)


class Killed(Program):
    def run(self) -> None:
        super().run()
        os.kill(os.getpid(), signal.SIGKILL)


class SegfaultBeforeTheEnd(Program):
    """Dies between the file and the end."""

    def run(self) -> None:
        self.answer.file("square.txt", b"4")
        self.stream.flush()
        os.kill(os.getpid(), signal.SIGSEGV)


class GivesNothing(Program):
    """Reads, and gives back neither a file nor a word."""

    def run(self) -> None:
        self.read()
        end(self.answer)


class EmptyFile(Program):
    """A file of no bytes, and no word."""

    def run(self) -> None:
        self.read()
        self.answer.file("square.txt", b"")
        end(self.answer)


class NoWord(Program):
    """A RESULT that says nothing of the outcome."""

    def run(self) -> None:
        self.read()
        self.answer.end({})


class OwnWord(Program):
    word: Any = "PASS"

    def run(self) -> None:
        number = self.read()
        self.answer.file("square.txt", str(number * number).encode())
        self.answer.end({"outcome": self.word})


class TrueWord(OwnWord):
    word = True


class NullWord(OwnWord):
    word = None


class SaysFailed(OwnWord):
    """An honest program of a bad product."""

    word = "failed"


class NanFigure(Program):
    def run(self) -> None:
        self.read()
        self.answer.end({"outcome": "passed", "figures": {"distance": math.nan}})


class InfiniteFigure(Program):
    def run(self) -> None:
        self.read()
        self.answer.end({"outcome": "passed", "figures": {"distance": math.inf}})


class TwoWords(Program):
    """Says failed, and then passed."""

    def run(self) -> None:
        self.read()
        self.answer._frame(RESULT, msgpack.packb({"outcome": "failed", "message": "hit a wall"}))
        self.answer.end(dict(PASSED))


class Prints(Program):
    """Prints between the frames."""

    def run(self) -> None:
        self.read()
        self.stream.write(b"all is well\n")
        self.answer.end(dict(PASSED))


class NoEnd(Program):
    """Leaves with status 0 before its end."""

    def run(self) -> None:
        self.read()
        self.answer.file("square.txt", b"4")
        self.stream.flush()


class NeverEnds(Program):
    """Has published all, and stays."""

    def run(self) -> None:
        super().run()
        threading.Event().wait(600)


class ShortFile(Program):
    """Promises a hundred bytes and gives one."""

    def run(self) -> None:
        self.read()
        self.answer._frame(FILE, msgpack.packb({"name": "square.txt", "size": 100}))
        self.answer._frame(3, b"4")
        self.answer._files, self.answer._bytes = 1, 1
        self.answer.end(dict(PASSED))


class SameNameTwice(Program):
    """The second file would replace the first one."""

    def run(self) -> None:
        number = self.read()
        self.answer.file("square.txt", b"wrong")
        self.answer.file("square.txt", str(number * number).encode())
        self.answer.end(dict(PASSED))


class CaughtTheError(Program):
    """Swallows its own failure: no file, no word, status 0."""

    def run(self) -> None:
        try:
            raise ValueError(f"no square of {self.read()}")
        except ValueError as error:
            print(error, file=sys.stderr)
        end(self.answer)


class Misspelt(Program):
    """Says that it failed, in a key that nobody reads."""

    def run(self) -> None:
        self.answer.file("square.txt", str(self.read() ** 2).encode())
        self.answer.end({"outcom": "failed"})


class OnlyFigures(Program):
    """Figures, and no verdict on them."""

    def run(self) -> None:
        self.answer.file("square.txt", str(self.read() ** 2).encode())
        self.answer.end({"figures": {"gap": -3.5}})


class Plain(Program):
    """The honest one."""


class OnlyAFile(Program):
    """No word at all, and the file."""

    def run(self) -> None:
        number = self.read()
        self.answer.file("square.txt", str(number * number).encode())
        end(self.answer)


class Talkative(Program):
    """A thousand lines that look like errors, on stderr."""

    def run(self) -> None:
        for line in range(1000):
            print(f"ERROR {line}: nothing", file=sys.stderr)
        super().run()


class SlowProgram(Program):
    def run(self) -> None:
        threading.Event().wait(1.5)
        super().run()


class ChildSaysNo(Program):
    """A child whose status 1 is an answer, as grep's is."""

    def run(self) -> None:
        subprocess.run(["/usr/bin/grep", "-q", "x", "/dev/null"], check=False)
        super().run()


def end(answer: Answer) -> None:
    """END without a RESULT."""
    frame = answer._frame
    answer._frame = lambda kind, payload: frame(kind, payload) if kind != RESULT else None  # type: ignore[method-assign]
    answer.end({})


def main() -> int:
    wanted = sys.argv[1]
    for word, program in list(globals().items()):
        if isinstance(program, type) and re.sub(r"(?<=.)([A-Z])", r"-\1", word).lower() == wanted:
            mark = Path(os.environ["LIAR_MARKS"], f"{os.environ['LIAR_NAME']}.ran")
            with mark.open("a") as file:
                file.write(f"{os.getpid()}\n")
            program().run()
            return 0
    return 2


if __name__ == "__main__":
    sys.exit(main())
