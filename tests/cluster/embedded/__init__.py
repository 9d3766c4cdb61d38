"""A real Kubernetes on one Linux machine, without Docker and without a registry.

It is for demonstrations and tests: etcd does not sync to disk and nothing survives a reboot.
Everything runs in one network namespace per node, so that nothing leaves the machine, and
below one control group per cluster, so that `down` finds every process it has to end.
"""
