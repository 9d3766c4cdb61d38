// A type whose samples are serialised messages as they are, whatever the message is.
#pragma once
#include <cstdint>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <functional>
#include <string>
#include <vector>

using Bytes = std::vector<uint8_t>; // a message with its encapsulation

class BlobType : public eprosima::fastdds::dds::TopicDataType {
 public:
  explicit BlobType(const std::string& name);
  bool serialize(void* data, eprosima::fastrtps::rtps::SerializedPayload_t* payload) override;
  bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* payload, void* data) override;
  std::function<uint32_t()> getSerializedSizeProvider(void* data) override;
  void* createData() override;
  void deleteData(void* data) override;
  bool getKey(void* data, eprosima::fastrtps::rtps::InstanceHandle_t* handle, bool md5) override;
};
