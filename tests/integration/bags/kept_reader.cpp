// What rosbag's C++ reads of bags: a line of tab-separated values for each message.
// Arguments: bags. A line with a bag's name goes before its messages.
#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <boost/crc.hpp>
#include <cstdio>
#include <string>
#include <vector>

static unsigned checksum(const void* data, size_t size) {
  boost::crc_32_type crc;
  crc.process_bytes(data, size);
  return crc.checksum();
}

int main(int count, char** names) {
  for (int at = 1; at < count; ++at) {
    printf("%s\n", names[at]);
    try {
      rosbag::Bag bag(names[at], rosbag::bagmode::Read);
      rosbag::View all(bag);
      for (const rosbag::MessageInstance& message : all) {
        std::vector<uint8_t> bytes(message.size());
        ros::serialization::OStream stream(bytes.data(), bytes.size());
        message.write(stream);
        const std::string definition = message.getMessageDefinition();
        printf("%s\t%llu\t%zu\t%u\t%s\t%d\t%s\t%s\t%u\n", message.getTopic().c_str(),
               static_cast<unsigned long long>(message.getTime().toNSec()), bytes.size(),
               checksum(bytes.data(), bytes.size()), message.getCallerId().c_str(),
               int(message.isLatching()), message.getDataType().c_str(),
               message.getMD5Sum().c_str(), checksum(definition.data(), definition.size()));
      }
    } catch (const std::exception& error) {
      printf("%s\n", error.what());
    }
  }
}
