"""What the bench of fleets adds to Spark, compiled: a cluster manager that starts nothing, and
executors that are simulated.
"""

import hashlib
import subprocess
import zipfile
from pathlib import Path

import pyspark
from context import cache
from lock import locked

SOURCES = Path(__file__).parent / "java"
SERVICE = "META-INF/services/org.apache.spark.scheduler.ExternalClusterManager"
COMPILE_SECONDS = 300.0


def jars() -> Path:
    """Spark's own."""
    return Path(pyspark.__file__).parent / "jars"


def compiled() -> Path:
    """The jar, kept in the cache by its sources' content."""
    sources = sorted(SOURCES.glob("*.java"))
    content = b"".join(path.read_bytes() for path in sources) + pyspark.__version__.encode()
    folder = cache() / f"fleet-{hashlib.sha256(content).hexdigest()[:16]}"
    jar = folder / "fleet.jar"
    with locked(folder.with_suffix(".lock"), COMPILE_SECONDS):
        if not jar.exists():
            classes = folder / "classes"
            subprocess.run(
                ["javac", "-d", classes, "-cp", f"{jars()}/*", *sources], check=True,
                timeout=COMPILE_SECONDS,
            )  # fmt: skip
            made = jar.with_suffix(".new")
            with zipfile.ZipFile(made, "w") as packed:
                packed.writestr(SERVICE, "bagpipe.bench.NoClusterManager\n")
                for path in sorted(classes.rglob("*.class")):
                    packed.write(path, path.relative_to(classes))
            made.replace(jar)
    return jar
