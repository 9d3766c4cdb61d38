/* A program of DDS without ROS 2, whose topics and types have ROS 2's names: what comes on one topic
 * it publishes on another, byte for byte.
 *
 *   dds_relay /in /out package/Type [16|24 /namespace/name]
 *
 * With the last two it announces itself as ROS 2 linked statically does: on ros_discovery_info, with
 * GUIDs of so many bytes (24 before Iron). SIGINT and SIGTERM end it. */
#define _GNU_SOURCE
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "blob.h"
#include "loopback.h"

static dds_entity_t participant;
static volatile sig_atomic_t ending;

static void stop(int signal) {
  (void)signal;
  ending = 1;
}

static dds_entity_t checked(const char *what, dds_entity_t made) {
  if (made >= 0) return made;
  fprintf(stderr, "dds_relay: %s: %s\n", what, dds_strretcode(made));
  exit(1);
}

static dds_entity_t topic(const char *name, const char *type, const void **made) {
  char ros[600];
  const char *slash = strchr(type, '/');
  if (slash == NULL) exit(2);
  snprintf(ros, sizeof ros, "%.*s::msg::dds_::%s_", (int)(slash - type), type, slash + 1);
  return checked(name, blob_topic(participant, name, ros, made));
}

static dds_qos_t *reliable(bool late) {
  dds_qos_t *qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_INFINITY);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, late ? 1 : 1000);
  if (late) dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
  return qos;
}

struct message {
  uint8_t bytes[4096];
  size_t length;
};

static void put(struct message *into, const void *bytes, size_t length) {
  memcpy(into->bytes + into->length, bytes, length);
  into->length += length;
}

static void put_number(struct message *into, uint32_t number) {
  while (into->length % 4 != 0) put(into, "", 1);
  put(into, &number, sizeof number);
}

static void put_text(struct message *into, const char *text) {
  put_number(into, (uint32_t)strlen(text) + 1);
  put(into, text, strlen(text) + 1);
}

static void put_guid(struct message *into, dds_entity_t of, size_t size) {
  dds_guid_t guid;
  checked("dds_get_guid", dds_get_guid(of, &guid));
  put(into, guid.v, sizeof guid.v);
  while (size-- > sizeof guid.v) put(into, "", 1);
}

static void announce(dds_entity_t reader, dds_entity_t writer, size_t size, const char *name) {
  char space[256];
  const char *last = strrchr(name, '/');
  snprintf(space, sizeof space, "%.*s", last == name ? 1 : (int)(last - name), name);
  struct message message = {{0, 1, 0, 0}, 4};
  put_guid(&message, participant, size);
  put_number(&message, 1);
  put_text(&message, space);
  put_text(&message, last + 1);
  put_number(&message, 1);
  put_guid(&message, reader, size);
  put_number(&message, 1);
  put_guid(&message, writer, size);
  const void *type;
  dds_entity_t info =
      topic("ros_discovery_info", "rmw_dds_common/ParticipantEntitiesInfo", &type);
  dds_entity_t announcement =
      checked("announce", dds_create_writer(participant, info, reliable(true), NULL));
  checked("announce", blob_write(announcement, type, message.bytes, message.length));
}

int main(int argc, char **argv) {
  if (argc != 4 && argc != 6) return 2;
  struct sigaction action = {.sa_handler = stop};
  sigaction(SIGINT, &action, NULL);
  sigaction(SIGTERM, &action, NULL);
  const char *number = getenv("ROS_DOMAIN_ID");
  dds_domainid_t domain = number == NULL ? 0 : (dds_domainid_t)atoi(number);
  dds_entity_t own = checked("domain", loopback_domain(domain));
  dds_qos_t *data = dds_create_qos();
  if (argc == 6) dds_qset_userdata(data, "enclave=/;", 10);
  participant = checked("participant", dds_create_participant(domain, data, NULL));
  char in[300], out[300];
  snprintf(in, sizeof in, "rt%s", argv[1]);
  snprintf(out, sizeof out, "rt%s", argv[2]);
  const void *type;
  dds_entity_t from = topic(in, argv[3], &type);
  dds_entity_t reader =
      checked(in, dds_create_reader(participant, from, reliable(false), NULL));
  dds_entity_t into = topic(out, argv[3], &type);
  dds_entity_t writer =
      checked(out, dds_create_writer(participant, into, reliable(false), NULL));
  if (argc == 6) announce(reader, writer, (size_t)atoi(argv[4]), argv[5]);
  dds_entity_t set = dds_create_waitset(participant);
  dds_entity_t condition = dds_create_readcondition(reader, DDS_ANY_STATE);
  checked("wait", dds_waitset_attach(set, condition, 0));
  while (!ending) {
    dds_waitset_wait(set, NULL, 0, DDS_MSECS(100));
    dds_sample_info_t info;
    const uint8_t *bytes;
    size_t length;
    struct ddsi_serdata *one;
    while ((one = blob_take(reader, &info, &bytes, &length)) != NULL) {
      checked(out, blob_write(writer, type, bytes, length));
      blob_release(one);
    }
  }
  /* With all that is in it: a participant alone is deleted later, and nobody learns of it if the program ends first. */
  dds_delete(own);
  return 0;
}
