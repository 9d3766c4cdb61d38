package bagpipe.bench;

import java.nio.ByteBuffer;
import java.nio.charset.StandardCharsets;
import java.util.Arrays;
import java.util.List;
import java.util.regex.Matcher;
import java.util.regex.Pattern;
import org.apache.spark.SparkConf;
import org.apache.spark.api.python.PythonAccumulatorV2;
import org.apache.spark.scheduler.DirectTaskResult;
import org.apache.spark.serializer.JavaSerializer;
import org.apache.spark.serializer.SerializerInstance;
import org.apache.spark.util.AccumulatorV2;
import scala.jdk.javaapi.CollectionConverters;
import scala.reflect.ClassTag;

/**
 * What a task of one case answers, as a Python worker would: the case's row for the driver's
 * accumulator. The case's name is read out of the task that the driver has sent.
 */
final class CaseResult {
  /** As in the row that Python has made, where the task's own name is put. */
  private static final String PLACE = "drive-0000-0000";
  private static final Pattern NAME = Pattern.compile("drive-[0-9]{4}-[0-9]{4}");

  private final SparkConf conf;
  private final byte[] accumulator;
  private final byte[] value;
  private final byte[] row;
  private final int place;

  CaseResult(SparkConf conf, byte[] accumulator, byte[] value, byte[] row) {
    this.conf = conf;
    this.accumulator = accumulator;
    this.value = value;
    this.row = row;
    this.place = latin(row).indexOf(PLACE);
    if (place < 0) {
      throw new IllegalArgumentException("the row has no case " + PLACE);
    }
  }

  /** The bytes of a status update that says a task has succeeded. */
  ByteBuffer of(ByteBuffer task) {
    byte[] made = row.clone();
    byte[] name = name(task).getBytes(StandardCharsets.ISO_8859_1);
    System.arraycopy(name, 0, made, place, name.length);
    SerializerInstance serializer = new JavaSerializer(conf).newInstance();
    // As it comes to an executor: the driver's, empty.
    PythonAccumulatorV2 rows = serializer.deserialize(ByteBuffer.wrap(accumulator), any());
    rows.add(made);
    ByteBuffer whole = serializer.serialize(new byte[][] {value}, any());
    List<AccumulatorV2<?, ?>> updates = List.of(rows);
    return serializer.serialize(
        new DirectTaskResult<Object>(
            whole, CollectionConverters.asScala(updates).toSeq(), new long[0]),
        any());
  }

  private static String name(ByteBuffer task) {
    ByteBuffer own = task.duplicate();
    byte[] bytes = new byte[own.remaining()];
    own.get(bytes);
    Matcher found = NAME.matcher(latin(bytes));
    if (!found.find()) {
      throw new IllegalArgumentException("a task without a case: " + Arrays.hashCode(bytes));
    }
    return found.group();
  }

  /** A character for each byte, so that places are the same. */
  private static String latin(byte[] bytes) {
    return new String(bytes, StandardCharsets.ISO_8859_1);
  }

  @SuppressWarnings("unchecked")
  static <T> ClassTag<T> any() {
    return (ClassTag<T>) scala.reflect.ClassTag$.MODULE$.Any();
  }
}
