"""Credentials of a job's Secrets: from the names that the operator gives them to their own.

The operator passes a Secret's key AWS_REGION as BAGPIPE_SECRET_0_AWS_REGION, so that a Secret
can't change how the pod's programs are loaded. Only names that hold a credential or a place are
taken over: one that names a token's file, beside one that names who gets it, would send the
driver's own token away; HADOOP_CONF_DIR would put a user's folder on the JVM's class path.
"""

import os
import re

from bagpipe.secret_names import SECRET_PREFIX

_TAKEN = (
    r"AWS_(?:ACCESS_KEY_ID|SECRET_ACCESS_KEY|SESSION_TOKEN|REGION|DEFAULT_REGION|ENDPOINT_URL"
    r"|ALLOW_HTTP|SKIP_SIGNATURE|VIRTUAL_HOSTED_STYLE_REQUEST|REQUEST_PAYER)"
    r"|AZURE_STORAGE_(?:ACCOUNT_NAME|ACCOUNT_KEY|SAS_KEY|CLIENT_ID|CLIENT_SECRET|TENANT_ID)"
    r"|GOOGLE_SERVICE_ACCOUNT_KEY|HADOOP_USER_NAME"
)
_NAME = re.compile(rf"{SECRET_PREFIX}(\d)_({_TAKEN})")


def take_over_secrets() -> None:
    """Set the storage's own variables in this process; a later Secret's value wins."""
    for variable in sorted(os.environ):
        found = _NAME.fullmatch(variable)
        if found:
            os.environ[found[2]] = os.environ[variable]
