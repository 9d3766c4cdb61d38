// Writes and reads bags with Debian's rosbag_storage, as JSON lines like those of
// images/ros/crates/bag/examples/bench.rs.
// Arguments: PAYLOAD FOLDER_ON_DISK FOLDER_IN_TMPFS SCALE.
#include <fcntl.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sys/mman.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <fstream>
#include <stdexcept>
#include <vector>

/// A message that is its bytes already: the least work that the library can have with one.
struct Raw {
  const uint8_t* data;
  uint32_t size;
};

namespace ros {
namespace message_traits {
template <> struct MD5Sum<Raw> {
  static const char* value() { return "992ce8a1687cec8c8bd883ec73ca41d1"; }
  static const char* value(const Raw&) { return value(); }
};
template <> struct DataType<Raw> {
  static const char* value() { return "std_msgs/String"; }
  static const char* value(const Raw&) { return value(); }
};
template <> struct Definition<Raw> {
  static const char* value() { return "string data\n"; }
  static const char* value(const Raw&) { return value(); }
};
template <> struct IsMessage<Raw> : TrueType {};
template <> struct IsMessage<const Raw> : TrueType {};
}  // namespace message_traits
namespace serialization {
template <> struct Serializer<Raw> {
  template <typename Stream> static void write(Stream& stream, const Raw& raw) {
    memcpy(stream.advance(raw.size), raw.data, raw.size);
  }
  static uint32_t serializedLength(const Raw& raw) { return raw.size; }
};
}  // namespace serialization
}  // namespace ros

struct Case {
  const char* name;
  size_t size;
  size_t count;
  rosbag::CompressionType compression;
};

static double seconds() {
  using clock = std::chrono::steady_clock;
  return std::chrono::duration<double>(clock::now().time_since_epoch()).count();
}

static void say(const Case& c, const char* metric, const char* where, double took) {
  const bool small = c.size == 1024;
  const double amount = small ? double(c.count) : double(c.count) * double(c.size) / 1e6;
  printf("{\"case\": \"%s\", \"metric\": \"%s\", \"unit\": \"%s\", \"by\": \"rosbag C++, %s\", "
         "\"value\": %.6f}\n", c.name, metric, small ? "msg/s" : "MB/s", where, amount / took);
  fflush(stdout);
}

static void write_bag(const Case& c, const std::vector<uint8_t>& payload, const std::string& path) {
  rosbag::Bag bag;
  bag.open(path, rosbag::bagmode::Write);
  bag.setCompression(c.compression);
  const size_t distinct = payload.size() / c.size;
  for (size_t number = 0; number < c.count; number++) {
    const Raw raw{payload.data() + number % distinct * c.size, uint32_t(c.size)};
    const uint64_t time = 1700000000000000000ull + number * 1000000ull;
    bag.write("/chatter", ros::Time(time / 1000000000ull, time % 1000000000ull), raw);
  }
  bag.close();
}

static void read_bag(const Case& c, const std::string& path) {
  rosbag::Bag bag;
  bag.open(path, rosbag::bagmode::Read);
  rosbag::View view(bag);
  std::vector<uint8_t> copy(c.size);
  size_t count = 0;
  for (const rosbag::MessageInstance& message : view) {
    ros::serialization::OStream stream(copy.data(), copy.size());
    message.write(stream);
    count++;
  }
  bag.close();
  if (count != c.count) throw std::runtime_error("not all messages were read");
}

static void forget(const std::string& path) {
  const int file = open(path.c_str(), O_RDONLY);
  if (file < 0 || fsync(file) != 0 || posix_fadvise(file, 0, 0, POSIX_FADV_DONTNEED) != 0)
    throw std::runtime_error("cannot drop " + path + " from the page cache");
  close(file);
}

static void measure(const Case& c, const std::vector<uint8_t>& payload, const char* where,
                    const std::string& path) {
  const bool disk = std::string(where) == "disk";
  double start = seconds();
  write_bag(c, payload, path);
  say(c, "write", where, seconds() - start);
  if (disk) {
    forget(path);
    start = seconds();
    read_bag(c, path);
    say(c, "read", "disk cold", seconds() - start);
  }
  start = seconds();
  read_bag(c, path);
  say(c, "read", disk ? "disk hot" : where, seconds() - start);
}

int main(int, char** arguments) {
  std::ifstream file(arguments[1], std::ios::binary);
  const std::vector<uint8_t> payload((std::istreambuf_iterator<char>(file)), {});
  const double scale = atof(arguments[4]);
  const auto count = [&](double base) { return size_t(std::max(1.0, base * scale)); };
  const std::vector<Case> cases = {
      {"1 KB", 1 << 10, count(300000), rosbag::compression::Uncompressed},
      {"1 MB", 1 << 20, count(400), rosbag::compression::Uncompressed},
      {"1 KB lz4", 1 << 10, count(200000), rosbag::compression::LZ4},
      {"1 MB lz4", 1 << 20, count(200), rosbag::compression::LZ4},
      {"1 KB bz2", 1 << 10, count(10000), rosbag::compression::BZ2},
  };
  for (const Case& c : cases) {
    const std::string disk = std::string(arguments[2]) + "/cpp.bag";
    measure(c, payload, "disk", disk);
    unlink(disk.c_str());
    if (c.compression != rosbag::compression::Uncompressed) continue;
    const std::string tmpfs = std::string(arguments[3]) + "/cpp.bag";
    measure(c, payload, "tmpfs", tmpfs);
    unlink(tmpfs.c_str());
    const int memory = memfd_create("bag", 0);
    measure(c, payload, "memfd", "/proc/self/fd/" + std::to_string(memory));
    close(memory);
  }
}
