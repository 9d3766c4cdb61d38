package bagpipe.bench;

import java.io.IOException;
import java.nio.file.Files;
import java.nio.file.Path;
import java.util.ArrayList;
import java.util.List;
import java.util.concurrent.ExecutorService;
import java.util.concurrent.Executors;
import java.util.concurrent.Future;
import java.util.concurrent.ScheduledExecutorService;
import java.util.concurrent.atomic.AtomicLong;
import org.apache.spark.SparkConf;

/**
 * Many executors in one JVM, each with a connection of its own, which speak as Spark's do and run
 * nothing.
 *
 * <p>Arguments: the driver's URL, the first one's number, how many, milliseconds of a case, and a
 * folder with what a case answers (`value`, `row`, and the `accumulator` that takes rows). Standard
 * input's end is theirs; then a line says how many cases they ended and how many heartbeats were answered.
 */
public final class SimulatedExecutors {
  static final int REGISTERING_AT_ONCE = 16;

  final String driver;
  final long caseMillis;
  final CaseResult result;
  final SparkConf conf;
  final ScheduledExecutorService clock = Executors.newScheduledThreadPool(4, daemon());
  final AtomicLong ended = new AtomicLong();
  final AtomicLong heartbeats = new AtomicLong();

  private SimulatedExecutors(String driver, long caseMillis, CaseResult result, SparkConf conf) {
    this.driver = driver;
    this.caseMillis = caseMillis;
    this.result = result;
    this.conf = conf;
  }

  public static void main(String[] words) throws Exception {
    SparkConf conf = settings();
    Path folder = Path.of(words[4]);
    byte[] accumulator = Files.readAllBytes(folder.resolve("accumulator"));
    byte[] value = Files.readAllBytes(folder.resolve("value"));
    byte[] row = Files.readAllBytes(folder.resolve("row"));
    CaseResult result = new CaseResult(conf, accumulator, value, row);
    SimulatedExecutors all =
        new SimulatedExecutors(words[0], Long.parseLong(words[3]), result, conf);
    all.start(Integer.parseInt(words[1]), Integer.parseInt(words[2]));
    waitForTheEnd();
    System.out.println(all.ended.get() + " " + all.heartbeats.get());
    // Threads of a thousand connections are not waited for.
    Runtime.getRuntime().halt(0);
  }

  /** Those of a job's executors that change what is sent, and few threads for each of so many. */
  private static SparkConf settings() {
    return new SparkConf(true)
        .set("spark.rpc.io.clientThreads", "1")
        .set("spark.rpc.io.serverThreads", "1")
        .set("spark.rpc.netty.dispatcher.numThreads", "1")
        .set("spark.rpc.connect.threads", "1");
  }

  private void start(int first, int count) throws Exception {
    ExecutorService starters = Executors.newFixedThreadPool(REGISTERING_AT_ONCE, daemon());
    List<Future<?>> begun = new ArrayList<>();
    for (int number = first; number < first + count; number++) {
      SimulatedExecutor executor = new SimulatedExecutor(this, Integer.toString(number));
      begun.add(starters.submit(executor::register));
    }
    for (Future<?> each : begun) {
      each.get();
    }
    starters.shutdown();
  }

  private static void waitForTheEnd() throws IOException {
    while (System.in.read() >= 0) {
      // Nobody writes: the end is all that is waited for.
    }
  }

  static java.util.concurrent.ThreadFactory daemon() {
    return work -> {
      Thread made = new Thread(work);
      made.setDaemon(true);
      return made;
    };
  }
}
