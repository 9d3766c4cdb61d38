"""Becomes the stack of a row: start.py ROW. The file LIAR_COMMANDS has the command of each."""

import json
import os
import pathlib
import sys

row = sys.argv[1]
os.environ["LIAR_NAME"] = row
command = json.loads(pathlib.Path(os.environ["LIAR_COMMANDS"]).read_text())[row]
os.execv(command[0], command)
