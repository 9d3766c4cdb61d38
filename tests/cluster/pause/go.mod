// The container that holds a pod's network namespace.
module bagpipe.io/tests/cluster/pause

go 1.24.0
