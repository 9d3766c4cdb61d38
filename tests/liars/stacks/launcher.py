"""Starts nodes as roslaunch does, and hides how they end: launcher.py [OPTIONS] PROGRAM ... ++ ...

--respawn restarts what has ended; --set-up waits for the first program, which is none of the
nodes, before it starts the others; --leave ends when a node has received its first pose, and the
nodes stay; --together lets no node subscribe before all of them are about to.
"""

import os
import signal
import subprocess
import sys
import threading

from marks import runs_before


def groups(words):
    found = [[]]
    for word in words:
        if word == "++":
            found.append([])
        else:
            found[-1].append(word)
    return found


def respawn(children, commands):
    for place, child in enumerate(children):
        if child.poll() is not None:
            children[place] = subprocess.Popen(commands[place])


def main():
    options = [word for word in sys.argv[1:] if word.startswith("--")]
    commands = groups([word for word in sys.argv[1:] if word not in options])
    over = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: over.set())
    signal.signal(signal.SIGTERM, lambda *_: over.set())
    if "--set-up" in options:
        subprocess.run(commands.pop(0), check=False)
    if "--together" in options:
        os.environ["LIAR_TOGETHER"] = str(runs_before("near") + len(commands))
    alone = "--leave" in options
    before = runs_before()
    children = [subprocess.Popen(command, start_new_session=alone) for command in commands]
    while not over.wait(0.05):
        if alone and runs_before() > before:
            return
        if "--respawn" in options:
            respawn(children, commands)
    for child in children:
        if child.poll() is None:
            child.send_signal(signal.SIGINT)
    for child in children:
        child.wait()


main()
