"""Deletes the pods of executors that have nothing left to do, in seconds whatever goes wrong.

Spark deletes them too when it stops, with the grace period of their pods, in which a case may end
that runs when its node is drained. A kubelet (1.34, `killContainer`) that can't stop the main
container, because it ends at just that moment, keeps the pod's sidecars for all of that period:
ten minutes in which a finished job holds a node's places.
"""

import logging
from pathlib import Path
from urllib.parse import quote, urlencode

from py4j.protocol import Py4JError
from pyspark import SparkContext

from bagpipe.driver.api_server import ACCOUNT, API_SERVER, delete

# For what ends in order, and then for whatever does not.
GRACE_SECONDS = 10

log = logging.getLogger(__name__)


def remove_executors(
    spark: SparkContext, namespace: str, server: str = API_SERVER, account: Path = ACCOUNT
) -> None:
    """Delete the pods of all executors of a Spark that stops now, before it does so itself.

    Where it can't be done Spark's own way is left, which needs longer only when it fails.
    """
    try:
        remove_executors_of(spark.applicationId, namespace, server, account)
    except (OSError, ValueError, AttributeError, Py4JError) as error:
        log.warning("the executors have the grace period of their pods: %s", error)


def remove_executors_of(application: str, namespace: str, server: str, account: Path) -> None:
    """Delete the pods of all executors of a Spark application. Raises OSError and ValueError."""
    selector = f"spark-app-selector={application},spark-role=executor"
    path = f"/api/v1/namespaces/{quote(namespace)}/pods?{urlencode({'labelSelector': selector})}"
    options = {"apiVersion": "v1", "kind": "DeleteOptions", "gracePeriodSeconds": GRACE_SECONDS}
    delete(path, options, server, account)
