"""`bagpipe doctor`: what a machine, a cluster and a namespace lack. Deciders are pure."""
