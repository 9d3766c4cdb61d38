"""Asks a master to hold and to answer more than it may.

Usage: bounds.py URI. Prints `bound` if it refused what is too much and answered what is not.
"""

import sys
import xmlrpc.client

EIGHT_MB = "x" * (8 << 20)

master = xmlrpc.client.ServerProxy(sys.argv[1])
codes = [master.setParam("/me", f"/{number}", EIGHT_MB)[0] for number in range(4)]
assert codes == [1, 1, 1, -1], codes
every = {"methodName": "getParam", "params": ["/me", "/0"]}
answers = master.system.multicall([every] * 100)
assert [isinstance(answer, list) for answer in answers] == [True] * 8 + [False] * 92
assert "take more than 67108864 bytes" in answers[8]["faultString"], answers[8]
topic = {"methodName": "registerPublisher", "params": ["/me", "/t", "a/b", "http://127.0.0.1:1/"]}
topic["params"][1] = "/" + EIGHT_MB
codes = [master.system.multicall([topic])[0][0][0] for _ in range(9)]
assert codes == [1] * 7 + [-1] * 2, codes
print("bound")
