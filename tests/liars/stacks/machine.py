"""Stacks that hide what they use: machine.py WHICH."""

import subprocess
import sys

from localiser import Localiser, main, right, wait

MIB = 1 << 20


class TakesMemory(Localiser):
    """300 MiB, from the tenth pose on."""

    def received(self, number, pose):
        if number == 10:
            self.kept = bytearray(b"1") * (300 * MIB)
        self.say(right(pose))


class TakesMemoryShortly(Localiser):
    """300 MiB for a moment."""

    def received(self, number, pose):
        if number == 10:
            kept = bytearray(b"1") * (300 * MIB)
            del kept
        self.say(right(pose))


class HidesMemory(Localiser):
    """300 MiB in a process that has left its group and its session, and lost its parent."""

    def begin(self):
        word = ["/usr/bin/setsid", "--fork", sys.executable, "-c"]
        script = "kept = bytearray(b'1') * (300 << 20); print(flush=True)\nimport time"
        hidden = subprocess.Popen([*word, f"{script}; time.sleep(600)"], stdout=subprocess.PIPE)
        hidden.stdout.readline()
        wait(0.5)


class Modest(Localiser):
    """What a node of this kind needs."""


if __name__ == "__main__":
    main(globals())
