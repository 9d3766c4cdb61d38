/* Publishers and subscriptions of DDS, what is sent by them and taken. */
#include <stdio.h>
#include <string.h>

#include "blob.h"
#include "handles.h"
#include "participant.h"

struct endpoint {
  dds_entity_t entity, condition;
  const struct ddsi_sertype *type; /* what messages are made with */
};

static struct endpoint publishers[PLAYER_ENDPOINTS], subscriptions[PLAYER_ENDPOINTS];
static struct ddsi_serdata *last; /* that was taken */

/* A topic as ROS 2 names it, or a negative error. */
static dds_entity_t topic_of(const struct wanted *wanted, const struct ddsi_sertype **type) {
  char name[1024], type_name[1024];
  snprintf(name, sizeof name, "rt%.1000s", wanted->topic);
  snprintf(type_name, sizeof type_name, "%.255s::%.255s::dds_::%.255s_", wanted->package,
           wanted->folder, wanted->name);
  return blob_topic(participant, name, type_name, type);
}

/* As RMWs translate it. */
static dds_qos_t *qos_of(const struct qos *wanted) {
  dds_qos_t *qos = dds_create_qos();
  bool all = wanted->history == 2;
  dds_history_kind_t history = all ? DDS_HISTORY_KEEP_ALL : DDS_HISTORY_KEEP_LAST;
  int32_t depth = all ? DDS_LENGTH_UNLIMITED : (int32_t)wanted->depth;
  dds_qset_history(qos, history, depth);
  bool reliable = wanted->reliability == 1;
  dds_qset_reliability(qos, reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
                       DDS_INFINITY);
  if (wanted->durability == 1) {
    dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
    dds_qset_durability_service(qos, 0, history, depth, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED,
                                DDS_LENGTH_UNLIMITED);
  }
  if (wanted->deadline > 0) dds_qset_deadline(qos, (dds_duration_t)wanted->deadline);
  if (wanted->manual || wanted->lease > 0)
    dds_qset_liveliness(qos, wanted->manual ? DDS_LIVELINESS_MANUAL_BY_TOPIC : DDS_LIVELINESS_AUTOMATIC,
                        wanted->lease > 0 ? (dds_duration_t)wanted->lease : DDS_INFINITY);
  dds_qset_writer_data_lifecycle(qos, false);
  dds_qset_ignorelocal(qos, DDS_IGNORELOCAL_NONE);
  return qos;
}

bool publisher_make(const struct wanted *wanted, struct answer *into) {
  struct endpoint *made = &publishers[wanted->slot];
  dds_entity_t topic = topic_of(wanted, &made->type);
  if (topic < 0) return answer_dds(into, "dds_create_topic_sertype", topic);
  dds_qos_t *qos = qos_of(&wanted->qos);
  dds_qset_writer_batching(qos, true);
  made->entity = dds_create_writer(participant, topic, qos, NULL);
  dds_delete_qos(qos);
  return made->entity >= 0 || answer_dds(into, "dds_create_writer", made->entity);
}

bool publisher_gid(uint32_t slot, uint8_t gid[GID_BYTES]) {
  dds_guid_t guid;
  _Static_assert(sizeof guid == GID_BYTES, "a GUID as DDS has it");
  if (dds_get_guid(publishers[slot].entity, &guid) != DDS_RETCODE_OK) return false;
  memcpy(gid, &guid, sizeof guid);
  return true;
}

bool publisher_count(uint32_t slot, uint64_t *matched, struct answer *into) {
  dds_publication_matched_status_t status;
  dds_return_t failed = dds_get_publication_matched_status(publishers[slot].entity, &status);
  if (failed) return answer_dds(into, "dds_get_publication_matched_status", failed);
  *matched = status.current_count;
  return true;
}

/* That it fails shows in who takes it for dead. */
void publisher_show(uint32_t slot) { (void)!dds_assert_liveliness(publishers[slot].entity); }

static bool write(const struct endpoint *to, const uint8_t *bytes, size_t length,
                  char reason[REASON_MOST]) {
  if (length < 4) { /* what says how the rest is encoded */
    snprintf(reason, REASON_MOST, "%zu bytes are no serialised message", length);
    return false;
  }
  dds_return_t failed = blob_write(to->entity, to->type, bytes, length);
  if (failed < 0) snprintf(reason, REASON_MOST, "dds_forwardcdr: %s", dds_strretcode(failed));
  return failed >= 0;
}

bool publisher_send(uint32_t slot, const uint8_t *bytes, size_t length, bool more,
                    char reason[REASON_MOST]) {
  bool taken = write(&publishers[slot], bytes, length, reason);
  /* Also of those before it, if this one is refused. */
  if (!more) dds_write_flush(publishers[slot].entity);
  return taken;
}

void publisher_unmake(uint32_t slot) { dds_delete(publishers[slot].entity); }

bool subscription_make(const struct wanted *wanted, struct answer *into) {
  struct endpoint *made = &subscriptions[wanted->slot];
  dds_entity_t topic = topic_of(wanted, &made->type);
  if (topic < 0) return answer_dds(into, "dds_create_topic_sertype", topic);
  dds_qos_t *qos = qos_of(&wanted->qos);
  if (wanted->others) dds_qset_ignorelocal(qos, DDS_IGNORELOCAL_PARTICIPANT);
  made->entity = dds_create_reader(participant, topic, qos, NULL);
  dds_delete_qos(qos);
  if (made->entity < 0) return answer_dds(into, "dds_create_reader", made->entity);
  made->condition = dds_create_readcondition(made->entity, DDS_ANY_STATE);
  return made->condition >= 0 || answer_dds(into, "dds_create_readcondition", made->condition);
}

bool subscription_count(uint32_t slot, uint64_t *matched, struct answer *into) {
  dds_subscription_matched_status_t status;
  dds_return_t failed = dds_get_subscription_matched_status(subscriptions[slot].entity, &status);
  if (failed) return answer_dds(into, "dds_get_subscription_matched_status", failed);
  *matched = status.current_count;
  return true;
}

dds_entity_t subscription_condition(uint32_t slot) { return subscriptions[slot].condition; }

/* Who has left before its first message is taken is not known: then there are 0s. */
static void publisher_of(dds_entity_t reader, dds_instance_handle_t handle, uint8_t gid[GID_BYTES]) {
  if (handle_known(handle, gid)) return;
  dds_builtintopic_endpoint_t *found = dds_get_matched_publication_data(reader, handle);
  if (found == NULL) return;
  _Static_assert(sizeof found->key == GID_BYTES, "a GUID as DDS has it");
  memcpy(gid, &found->key, GID_BYTES);
  dds_builtintopic_free_endpoint(found);
  handle_keep(handle, gid);
}

enum took subscription_take(uint32_t slot, struct taken *into, char reason[REASON_MOST]) {
  if (last != NULL) blob_release(last);
  last = NULL;
  dds_sample_info_t info;
  struct ddsi_serdata *found;
  dds_return_t took = blob_take(subscriptions[slot].entity, &info, &found);
  if (took == 0) return TOOK_NOTHING;
  if (took < 0) {
    into->stamp = took;
    snprintf(reason, REASON_MOST, "dds_takecdr: %s", dds_strretcode(took));
    return TOOK_TROUBLE;
  }
  last = found;
  into->bytes = blob_bytes(found, &into->length);
  into->stamp = info.source_timestamp;
  publisher_of(subscriptions[slot].entity, info.publication_handle, into->publisher);
  return TOOK_ONE;
}

void subscription_unmake(uint32_t slot) { dds_delete(subscriptions[slot].entity); }
