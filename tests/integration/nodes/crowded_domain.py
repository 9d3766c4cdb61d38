"""crowded_domain.py COMMAND...: becomes the command, in a domain whose first 34 places are
taken, by sockets at the ports that so many participants would have."""

import os
import socket
import sys

PLACES = 34
first = 7400 + 250 * int(os.environ["ROS_DOMAIN_ID"])
for place in range(PLACES):
    # For discovery and for messages (DDSI-RTPS 2.3, 9.6.1.1).
    for port in (first + 10 + 2 * place, first + 11 + 2 * place):
        taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        taken.bind(("0.0.0.0", port))
        os.set_inheritable(taken.detach(), True)
os.execvp(sys.argv[1], sys.argv[1:])  # noqa: S606
