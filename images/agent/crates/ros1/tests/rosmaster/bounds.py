"""Asks a master to hold and to answer more than it may; prints what it took.

Usage: bounds.py URI. The first line has the codes of setting parameters of 8 MiB each, the second
which of 100 answers of 8 MiB in one call came and why the rest did not, the third the codes of
registrations whose names have 8 MiB.
"""

import sys
import xmlrpc.client

EIGHT_MB = "x" * (8 << 20)

master = xmlrpc.client.ServerProxy(sys.argv[1])
print([master.setParam("/me", f"/{number}", EIGHT_MB)[0] for number in range(4)])
every = {"methodName": "getParam", "params": ["/me", "/0"]}
answers = master.system.multicall([every] * 100)
whole = sum(isinstance(answer, list) for answer in answers)
print(whole, answers[whole]["faultString"])
publishes = ["/me", "/" + EIGHT_MB, "a/b", "http://127.0.0.1:1/"]
print([master.registerPublisher(*publishes)[0] for _ in range(9)])
