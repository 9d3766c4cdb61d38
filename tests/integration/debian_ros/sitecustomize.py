"""On a node's PYTHONPATH: Debian's rospy for the tests' own Python, behind its own packages."""

import sys

sys.path.append("/usr/lib/python3/dist-packages")
