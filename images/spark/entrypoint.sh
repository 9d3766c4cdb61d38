#!/bin/bash
# What a container of this image becomes: a job's driver, a Spark executor, or any command.
# The pyspark wheel carries Spark without the container entrypoint of Spark's own image.
set -euo pipefail

case "${1:-}" in
  driver)
    shift
    exec python3 -m bagpipe.driver "$@"
    ;;
  executor)
    # Spark hands the JVM's options over as SPARK_JAVA_OPT_0, _1, ...: their order counts.
    options=()
    for ((n = 0; ; n++)); do
      name="SPARK_JAVA_OPT_$n"
      [[ -v $name ]] || break
      options+=("${!name}")
    done
    exec java "${options[@]}" \
      "-Xms$SPARK_EXECUTOR_MEMORY" "-Xmx$SPARK_EXECUTOR_MEMORY" \
      -cp "$SPARK_HOME/conf:$SPARK_HOME/jars/*" \
      org.apache.spark.scheduler.cluster.k8s.KubernetesExecutorBackend \
      --driver-url "$SPARK_DRIVER_URL" \
      --executor-id "$SPARK_EXECUTOR_ID" \
      --cores "$SPARK_EXECUTOR_CORES" \
      --app-id "$SPARK_APPLICATION_ID" \
      --hostname "$SPARK_EXECUTOR_POD_IP" \
      --resourceProfileId "$SPARK_RESOURCE_PROFILE_ID" \
      --podName "$SPARK_EXECUTOR_POD_NAME"
    ;;
  *)
    exec "$@"
    ;;
esac
