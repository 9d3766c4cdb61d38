"""The maps that cross the pipe, each with the meaning, unit and range of its fields.

docs/reference/pipe-maps.json and the tables of docs/reference/binpipe.md are written from them
(docs/site/pipe_maps.py), and the agent's structs are compared with them
(tests/integration/test_pipe_maps.py). The case in HELLO is in bagpipe.wire.hello_case, and
each engine has the rest of its RESULT (`result.py` in its folder).
"""
