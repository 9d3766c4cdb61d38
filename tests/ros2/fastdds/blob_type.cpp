#include "blob_type.hpp"

#include <cstring>

using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;

BlobType::BlobType(const std::string& name) {
  setName(name.c_str());
  m_typeSize = 1024; // what is set aside at first: a history reallocates what is larger
  m_isGetKeyDefined = false;
  auto_fill_type_information(false);
  auto_fill_type_object(false);
}

bool BlobType::serialize(void* data, SerializedPayload_t* payload) {
  const Bytes& bytes = *static_cast<const Bytes*>(data);
  if (bytes.size() > payload->max_size) return false;
  payload->encapsulation = CDR_LE;
  payload->length = static_cast<uint32_t>(bytes.size());
  std::memcpy(payload->data, bytes.data(), bytes.size());
  return true;
}

bool BlobType::deserialize(SerializedPayload_t* payload, void* data) {
  static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
  return true;
}

std::function<uint32_t()> BlobType::getSerializedSizeProvider(void* data) {
  return [data] { return static_cast<uint32_t>(static_cast<const Bytes*>(data)->size()); };
}

void* BlobType::createData() { return new Bytes; }

void BlobType::deleteData(void* data) { delete static_cast<Bytes*>(data); }

bool BlobType::getKey(void*, InstanceHandle_t*, bool) { return false; }
