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


def stop_with_executors(
    spark: SparkContext, namespace: str, server: str = API_SERVER, account: Path = ACCOUNT
) -> None:
    """Stop Spark, and delete the pods of all its executors, before it does so itself.

    Where they can't be deleted Spark's own way is left, which needs longer only when it fails.
    """
    try:
        application = spark.applicationId
    except (OSError, AttributeError, Py4JError) as error:
        log.warning("the executors can not be found without Spark: %s", error)
        spark.stop()
        return
    _remove(application, namespace, server, account)
    spark.stop()
    # While the first ones went, Spark may have asked for others in their place.
    _remove(application, namespace, server, account)


def _remove(application: str, namespace: str, server: str, account: Path) -> None:
    selector = f"spark-app-selector={application},spark-role=executor"
    path = f"/api/v1/namespaces/{quote(namespace)}/pods?{urlencode({'labelSelector': selector})}"
    options = {"apiVersion": "v1", "kind": "DeleteOptions", "gracePeriodSeconds": GRACE_SECONDS}
    try:
        delete(path, options, server, account)
    except (OSError, ValueError) as error:
        log.warning("the executors have the grace period of their pods: %s", error)
