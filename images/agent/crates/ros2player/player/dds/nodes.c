/* What each participant has announced last of its nodes. */
#include "nodes.h"

#include <stdlib.h>
#include <string.h>

#include "blob.h"
#include "participant.h"

#define MOST_ANNOUNCED 1024           /* participants: more than a machine has ports for */
#define MOST_BYTES (1u << 20)    /* of one */
#define MOST_WAITING 1024        /* messages between two looks */

static struct announced {
  dds_guid_t participant;
  uint8_t *bytes;
  size_t length;
} all[MOST_ANNOUNCED];
static size_t count;
static dds_entity_t reader;

bool nodes_prepare(struct answer *into) {
  const struct ddsi_sertype *type;
  dds_entity_t topic = blob_topic(participant, DISCOVERY_TOPIC,
                                  "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_", &type);
  if (topic < 0) return answer_dds(into, "dds_create_topic_sertype", topic);
  dds_qos_t *qos = dds_create_qos();
  dds_qset_history(qos, DDS_HISTORY_KEEP_ALL, DDS_LENGTH_UNLIMITED);
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_INFINITY);
  dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
  dds_qset_resource_limits(qos, MOST_WAITING, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  reader = dds_create_reader(participant, topic, qos, NULL);
  dds_delete_qos(qos);
  return reader >= 0 || answer_dds(into, "dds_create_reader", reader);
}

static struct announced *find(const dds_guid_t *wanted) {
  for (size_t one = 0; one < count; one++)
    if (memcmp(&all[one].participant, wanted, sizeof *wanted) == 0) return &all[one];
  return NULL;
}

static void remember(const uint8_t *bytes, size_t length) {
  dds_guid_t whose;
  if (length > MOST_BYTES || !nodes_parse(bytes, length, &whose, NULL, NULL)) return;
  struct announced *known = find(&whose);
  if (known == NULL && count == MOST_ANNOUNCED) return;
  uint8_t *copy = malloc(length);
  if (copy == NULL) return;
  memcpy(copy, bytes, length);
  if (known == NULL) known = &all[count++];
  else free(known->bytes);
  *known = (struct announced){whose, copy, length};
}

void nodes_refresh(void) {
  dds_sample_info_t info;
  struct ddsi_serdata *found;
  for (int some = 0; some < MOST_WAITING && blob_take(reader, &info, &found) == 1; some++) {
    size_t length;
    const uint8_t *bytes = blob_bytes(found, &length);
    remember(bytes, length);
    blob_release(found);
  }
}

bool nodes_of(const dds_guid_t *wanted, visit_node *visitor, void *state) {
  dds_guid_t whose;
  const struct announced *known = find(wanted);
  return known != NULL && nodes_parse(known->bytes, known->length, &whose, visitor, state);
}

void nodes_forget(bool (*alive)(const dds_guid_t *, void *), void *state) {
  for (size_t one = 0; one < count;) {
    if (alive(&all[one].participant, state)) {
      one++;
    } else {
      free(all[one].bytes);
      all[one] = all[--count];
    }
  }
}
