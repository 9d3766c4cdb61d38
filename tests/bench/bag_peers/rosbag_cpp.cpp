// Writes and reads bags with Debian's rosbag_storage, as JSON lines like those of
// images/agent/crates/rosbag/examples/bench.
// Arguments: PAYLOAD FOLDER_ON_DISK FOLDER_IN_TMPFS SCALE LIST; LIST has lines of a case's name, a
// tab and the path of a bag that is read and written again.
#include <fcntl.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sys/mman.h>
#include <sys/stat.h>
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
  const char* md5sum = "992ce8a1687cec8c8bd883ec73ca41d1";
  const char* datatype = "std_msgs/String";
  const char* definition = "string data\n";
};

namespace ros {
namespace message_traits {
// A message says itself what it is; the library asks for the type alone as well.
template <> struct MD5Sum<Raw> {
  static const char* value() { return "*"; }
  static const char* value(const Raw& raw) { return raw.md5sum; }
};
template <> struct DataType<Raw> {
  static const char* value() { return "*"; }
  static const char* value(const Raw& raw) { return raw.datatype; }
};
template <> struct Definition<Raw> {
  static const char* value() { return ""; }
  static const char* value(const Raw& raw) { return raw.definition; }
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

static void say_size(const char* name, const std::string& path) {
  struct stat about;
  if (stat(path.c_str(), &about) != 0) throw std::runtime_error("cannot look at " + path);
  printf("{\"case\": \"%s\", \"metric\": \"size of the bag\", \"unit\": \"MB\", "
         "\"by\": \"rosbag C++, disk\", \"value\": %.6f}\n", name, about.st_size / 1e6);
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
    if (c.compression != rosbag::compression::Uncompressed) say_size(c.name, path);
    forget(path);
    start = seconds();
    read_bag(c, path);
    say(c, "read", "disk cold", seconds() - start);
  }
  start = seconds();
  read_bag(c, path);
  say(c, "read", disk ? "disk hot" : where, seconds() - start);
}

/// All messages of a bag, in memory.
struct Kept {
  std::string topic;
  ros::Time time;
  std::string md5sum, datatype, definition;
  std::vector<uint8_t> bytes;
};

/// Reads it into one buffer; how many bytes of messages there were.
static size_t read_any(const std::string& path, std::vector<uint8_t>& copy) {
  rosbag::Bag bag;
  bag.open(path, rosbag::bagmode::Read);
  rosbag::View view(bag);
  size_t bytes = 0;
  for (const rosbag::MessageInstance& message : view) {
    if (copy.size() < message.size()) copy.resize(message.size());
    ros::serialization::OStream stream(copy.data(), copy.size());
    message.write(stream);
    bytes += message.size();
  }
  return bytes;
}

static std::vector<Kept> keep(const std::string& path) {
  rosbag::Bag bag;
  bag.open(path, rosbag::bagmode::Read);
  rosbag::View view(bag);
  std::vector<Kept> kept;
  for (const rosbag::MessageInstance& message : view) {
    kept.push_back({message.getTopic(), message.getTime(), message.getMD5Sum(),
                    message.getDataType(), message.getMessageDefinition(),
                    std::vector<uint8_t>(message.size())});
    ros::serialization::OStream stream(kept.back().bytes.data(), message.size());
    message.write(stream);
  }
  return kept;
}

static void write_any(const std::vector<Kept>& kept, rosbag::CompressionType compression,
                      const std::string& path) {
  rosbag::Bag bag;
  bag.open(path, rosbag::bagmode::Write);
  bag.setCompression(compression);
  for (const Kept& each : kept)
    bag.write(each.topic, each.time,
              Raw{each.bytes.data(), uint32_t(each.bytes.size()), each.md5sum.c_str(),
                  each.datatype.c_str(), each.definition.c_str()});
  bag.close();
}

/// A case's name says how its bag is compressed.
static rosbag::CompressionType compression_of(const std::string& name) {
  if (name.find("lz4") != std::string::npos) return rosbag::compression::LZ4;
  if (name.find("bz2") != std::string::npos) return rosbag::compression::BZ2;
  return rosbag::compression::Uncompressed;
}

/// A bag is read, and written, so often that it is at least 32 MiB, but at most 20 times.
static void again(const std::string& name, const std::string& path, const std::string& folder) {
  const auto rate = [&](const char* metric, const char* where, size_t bytes, double took) {
    printf("{\"case\": \"%s\", \"metric\": \"%s\", \"unit\": \"MB/s\", "
           "\"by\": \"rosbag C++, %s\", \"value\": %.6f}\n",
           name.c_str(), metric, where, double(bytes) / 1e6 / took);
  };
  std::vector<uint8_t> copy(8 << 20);
  forget(path);
  double start = seconds();
  const size_t bytes = read_any(path, copy);
  rate("read", "disk cold", bytes, seconds() - start);
  const size_t times = std::min<size_t>(20, std::max<size_t>(1, (32 << 20) / bytes));
  start = seconds();
  for (size_t each = 0; each < times; each++) read_any(path, copy);
  rate("read", "disk hot", bytes * times, seconds() - start);
  const std::vector<Kept> kept = keep(path);
  const std::string made = folder + "/again.bag";
  start = seconds();
  for (size_t each = 0; each < times; each++) write_any(kept, compression_of(name), made);
  rate("write", "disk", bytes * times, seconds() - start);
  say_size(name.c_str(), made);
  unlink(made.c_str());
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
  std::ifstream list(arguments[5]);
  for (std::string line; std::getline(list, line);) {
    const size_t tab = line.find('\t');
    again(line.substr(0, tab), line.substr(tab + 1), arguments[2]);
  }
}
