// One reader or writer of a topic over Fast DDS, with the names, the types and the quality of service
// that ROS 2 has, and settings as rmw_fastrtps has them on localhost.
//
//   fastdds_endpoint read|write TOPIC PACKAGE/msg/TYPE DEPTH|all reliable|best_effort
//                    volatile|transient_local
//
// It writes frames: 'M' how many it has matched, whenever that changes; of a reader 'Q' how many writers
// offer less than it asks for, and 'D' each message that it takes; of a writer 'P' how many it has published, 'A' whether all of it was acknowledged
// within 10 s. It reads frames: a writer publishes the bytes of each 'D', and answers 'A'; a reader
// takes nothing before the first 'T', and answers 'L' with the last message that it had not looked at,
// if there is one. At the end of its input it leaves its domain, ROS_DOMAIN_ID, and ends.
#include <fastdds/dds/core/LoanableSequence.hpp>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include <atomic>
#include <cstdio>
#include <thread>

#include "blob_type.hpp"
#include "frames.hpp"

using namespace eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;

namespace {

[[noreturn]] void refuse(const char* why) {
  std::fprintf(stderr, "fastdds_endpoint: %s\n", why);
  std::exit(2);
}

struct Asked {
  bool reads;
  std::string topic, type, depth, reliability, durability;
};

// Unicast on loopback, to as many participants as rmw_fastrtps looks for.
DomainParticipant* join(const char* domain) {
  DomainParticipantQos qos = PARTICIPANT_QOS_DEFAULT;
  qos.transport().use_builtin_transports = false;
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->maxInitialPeersRange = 32;
  udp->interfaceWhiteList.push_back("127.0.0.1");
  qos.transport().user_transports.push_back(udp);
  auto& builtin = qos.wire_protocol().builtin;
  builtin.metatrafficMulticastLocatorList.clear();
  builtin.metatrafficUnicastLocatorList.push_back(rtps::Locator_t()); // else it adds a multicast one
  rtps::Locator_t here;
  rtps::IPLocator::setIPv4(here, "127.0.0.1");
  builtin.initialPeersList.push_back(here);
  const std::string about = "enclave=/;name=fastdds;namespace=/;";
  qos.user_data().assign(about.begin(), about.end());
  qos.name("/");
  auto* made = DomainParticipantFactory::get_instance()->create_participant(
      static_cast<uint32_t>(std::atoi(domain)), qos);
  if (made == nullptr) refuse("no participant");
  return made;
}

// Of writers and readers alike.
template <typename Qos>
Qos quality(Qos qos, const Asked& asked) {
  bool all = asked.depth == "all";
  qos.history().kind = all ? KEEP_ALL_HISTORY_QOS : KEEP_LAST_HISTORY_QOS;
  if (!all) qos.history().depth = std::atoi(asked.depth.c_str());
  qos.resource_limits().max_samples = 0; // no limit, as rmw_fastrtps' own of KEEP_ALL
  qos.resource_limits().max_samples_per_instance = 0;
  bool reliable = asked.reliability == "reliable";
  qos.reliability().kind = reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
  bool kept = asked.durability == "transient_local";
  qos.durability().kind = kept ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
  qos.endpoint().history_memory_policy =
      eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  qos.data_sharing().off();
  return qos;
}

struct Matches : DataReaderListener, DataWriterListener {
  void on_subscription_matched(DataReader*, const SubscriptionMatchedStatus& now) override {
    send_number('M', now.current_count);
  }
  void on_requested_incompatible_qos(DataReader*,
                                     const RequestedIncompatibleQosStatus& now) override {
    send_number('Q', now.total_count);
  }
  void on_publication_matched(DataWriter*, const PublicationMatchedStatus& now) override {
    send_number('M', now.current_count);
  }
} matches;

using Messages = LoanableSequence<Bytes>;

// Also those that were looked at.
void take(DataReader* reader, const std::atomic<bool>& ending) {
  while (!ending) {
    Messages messages;
    SampleInfoSeq infos;
    if (reader->take(messages, infos) != ReturnCode_t::RETCODE_OK) {
      reader->wait_for_unread_message(eprosima::fastrtps::Duration_t(0, 50'000'000));
      continue;
    }
    for (LoanableCollection::size_type one = 0; one < messages.length(); one++)
      if (infos[one].valid_data)
        send_frame('D', messages[one].data(), static_cast<uint32_t>(messages[one].size()));
    reader->return_loan(messages, infos);
  }
}

void look(DataReader* reader) {
  Bytes message;
  SampleInfo info;
  while (reader->read_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK) {
  }
  send_frame('L', message.data(), static_cast<uint32_t>(message.size()));
}

void read_topic(DomainParticipant* participant, Topic* topic, const Asked& asked) {
  auto* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
  auto qos = quality(DATAREADER_QOS_DEFAULT, asked);
  auto events = StatusMask::subscription_matched() << StatusMask::requested_incompatible_qos();
  auto* reader = subscriber->create_datareader(topic, qos, &matches, events);
  if (reader == nullptr) refuse("no reader");
  std::atomic<bool> ending{false};
  std::thread taking;
  char kind;
  Bytes nothing;
  while (next_frame(kind, nothing)) {
    if (kind == 'L') look(reader);
    if (kind == 'T' && !taking.joinable()) taking = std::thread([&] { take(reader, ending); });
  }
  ending = true;
  if (taking.joinable()) taking.join();
}

void write_topic(DomainParticipant* participant, Topic* topic, const Asked& asked) {
  auto* publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
  auto qos = quality(DATAWRITER_QOS_DEFAULT, asked);
  auto* writer =
      publisher->create_datawriter(topic, qos, &matches, StatusMask::publication_matched());
  if (writer == nullptr) refuse("no writer");
  int32_t published = 0;
  char kind;
  Bytes message;
  while (next_frame(kind, message)) {
    if (kind == 'D') {
      if (!writer->write(&message)) refuse("not written");
      send_number('P', ++published);
    } else if (kind == 'A') {
      auto done = writer->wait_for_acknowledgments(eprosima::fastrtps::Duration_t(10, 0));
      send_number('A', done == ReturnCode_t::RETCODE_OK);
    }
  }
}

// The DDS name of ROS 2's type `package/msg/Type`.
std::string dds_type(const std::string& type) {
  size_t first = type.find('/'), last = type.rfind('/');
  if (first == std::string::npos || first == last) refuse("no PACKAGE/msg/TYPE");
  return type.substr(0, first) + "::" + type.substr(first + 1, last - first - 1) +
         "::dds_::" + type.substr(last + 1) + "_";
}

} // namespace

int main(int argc, char** argv) {
  if (argc != 7) refuse("read|write TOPIC PACKAGE/msg/TYPE DEPTH RELIABILITY DURABILITY");
  Asked asked{argv[1] == std::string("read"), argv[2], argv[3], argv[4], argv[5], argv[6]};
  const char* domain = std::getenv("ROS_DOMAIN_ID");
  if (domain == nullptr) refuse("no ROS_DOMAIN_ID");
  auto* participant = join(domain);
  TypeSupport type(new BlobType(dds_type(asked.type)));
  type.register_type(participant);
  auto* topic = participant->create_topic("rt" + asked.topic, type.get_type_name(), TOPIC_QOS_DEFAULT);
  if (topic == nullptr) refuse("no topic");
  if (asked.reads) read_topic(participant, topic, asked);
  else write_topic(participant, topic, asked);
  participant->delete_contained_entities();
  DomainParticipantFactory::get_instance()->delete_participant(participant);
  return 0;
}
