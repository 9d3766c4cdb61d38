"""How the operator names a Secret's keys for the data plane; alone, as Spark's workers load it."""

# Before the names of a Secret's keys in the environment, with the Secret's number and `_`.
SECRET_PREFIX = "BAGPIPE_SECRET_"  # noqa: S105  a name and no secret
