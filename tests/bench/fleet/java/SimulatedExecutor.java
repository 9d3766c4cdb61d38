package bagpipe.bench;

import java.util.concurrent.ThreadLocalRandom;
import java.util.concurrent.TimeUnit;
import org.apache.spark.Heartbeat;
import org.apache.spark.SecurityManager;
import org.apache.spark.TaskState;
import org.apache.spark.rpc.RpcCallContext;
import org.apache.spark.rpc.RpcEndpointRef;
import org.apache.spark.rpc.RpcEnv;
import org.apache.spark.rpc.ThreadSafeRpcEndpoint;
import org.apache.spark.scheduler.TaskDescription;
import org.apache.spark.scheduler.cluster.CoarseGrainedClusterMessages;
import org.apache.spark.storage.BlockManagerId;
import org.apache.spark.storage.BlockManagerMessages;
import org.apache.spark.util.SerializableBuffer;
import scala.Enumeration;
import scala.Function1;
import scala.Option;
import scala.PartialFunction;
import scala.Tuple2;
import scala.collection.immutable.Map$;
import scala.runtime.AbstractPartialFunction;
import scala.runtime.BoxedUnit;

/** One executor of one core, by its messages: as CoarseGrainedExecutorBackend and Executor send. */
final class SimulatedExecutor implements ThreadSafeRpcEndpoint {
  private static final long HEARTBEAT_SECONDS = 10;
  private static final long MEMORY = 100L << 20;

  private final SimulatedExecutors all;
  private final String id;
  private final RpcEnv env;
  private final BlockManagerId blocks;
  private RpcEndpointRef driver;
  private RpcEndpointRef receiver;

  SimulatedExecutor(SimulatedExecutors all, String id) {
    this.all = all;
    this.id = id;
    SecurityManager security =
        new SecurityManager(
            all.conf,
            Option.empty(),
            org.apache.spark.internal.config.package$.MODULE$.AUTH_SECRET_FILE());
    env = RpcEnv.create("executor-" + id, "127.0.0.1", -1, all.conf, security, true);
    // Nobody listens there: a result of a case fits into its status update.
    blocks = BlockManagerId.apply(id, "127.0.0.1", 1, Option.empty());
  }

  @Override
  public RpcEnv rpcEnv() {
    return env;
  }

  /** Do what Spark's executor does before it is given a task. */
  void register() {
    driver = env.setupEndpointRefByURI(all.driver);
    ask(driver, new CoarseGrainedClusterMessages.RetrieveSparkAppConfig(0));
    RpcEndpointRef own = env.setupEndpoint("Executor", this);
    ask(
        driver,
        new CoarseGrainedClusterMessages.RegisterExecutor(
            id, own, "127.0.0.1", 1, none(), none(), none(), 0));
    RpcEndpointRef master = env.setupEndpointRef(driver.address(), "BlockManagerMaster");
    String[] folders = {"/nowhere"};
    ask(
        master,
        new BlockManagerMessages.RegisterBlockManager(blocks, folders, MEMORY, 0, own, false));
    receiver = env.setupEndpointRef(driver.address(), "HeartbeatReceiver");
    driver.send(new CoarseGrainedClusterMessages.LaunchedExecutor(id));
    long first = ThreadLocalRandom.current().nextLong(1000 * HEARTBEAT_SECONDS);
    all.clock.scheduleAtFixedRate(
        this::heartbeat, first, 1000 * HEARTBEAT_SECONDS, TimeUnit.MILLISECONDS);
  }

  private static Object ask(RpcEndpointRef whom, Object message) {
    return whom.askSync(message, CaseResult.any());
  }

  @SuppressWarnings({"unchecked", "rawtypes"})
  private void heartbeat() {
    scala.collection.mutable.Map peaks = new scala.collection.mutable.HashMap<>();
    Heartbeat beat = new Heartbeat(id, new Tuple2[0], blocks, peaks);
    receiver
        .ask(beat, CaseResult.any())
        .foreach(
            answer -> all.heartbeats.incrementAndGet(),
            scala.concurrent.ExecutionContext$.MODULE$.global());
  }

  @Override
  public PartialFunction<Object, BoxedUnit> receive() {
    return new Each(
        message -> {
          if (message instanceof CoarseGrainedClusterMessages.LaunchTask launch) {
            run(TaskDescription.decode(launch.data().value()));
          }
        });
  }

  /** What its block manager is asked for: to forget what it never had. */
  @Override
  public PartialFunction<Object, BoxedUnit> receiveAndReply(RpcCallContext context) {
    return new Each(
        message ->
            context.reply(
                message instanceof BlockManagerMessages.RemoveBroadcast
                        || message instanceof BlockManagerMessages.RemoveRdd
                    ? (Object) 0
                    : (Object) true));
  }

  private void run(TaskDescription task) {
    update(task, TaskState.RUNNING(), java.nio.ByteBuffer.allocate(0));
    all.clock.schedule(() -> end(task), all.caseMillis, TimeUnit.MILLISECONDS);
  }

  private void end(TaskDescription task) {
    try {
      update(task, TaskState.FINISHED(), all.result.of(task.serializedTask()));
      all.ended.incrementAndGet();
    } catch (RuntimeException error) {
      error.printStackTrace();
      Runtime.getRuntime().halt(1);
    }
  }

  private void update(TaskDescription task, Enumeration.Value state, java.nio.ByteBuffer data) {
    driver.send(
        new CoarseGrainedClusterMessages.StatusUpdate(
            id, task.taskId(), state, new SerializableBuffer(data), task.cpus(), task.resources()));
  }

  private static <V> scala.collection.immutable.Map<String, V> none() {
    return Map$.MODULE$.empty();
  }

  /** A Scala function over all messages. */
  private static final class Each extends AbstractPartialFunction<Object, BoxedUnit> {
    private final java.util.function.Consumer<Object> does;

    Each(java.util.function.Consumer<Object> does) {
      this.does = does;
    }

    @Override
    public boolean isDefinedAt(Object message) {
      return true;
    }

    @Override
    @SuppressWarnings("unchecked")
    public <A extends Object, B> B applyOrElse(A message, Function1<A, B> otherwise) {
      does.accept(message);
      return (B) BoxedUnit.UNIT;
    }
  }
}
