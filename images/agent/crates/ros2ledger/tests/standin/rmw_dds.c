/* librmw_implementation.so of the stand-in over Debian's Cyclone DDS: the same queues as a real
 * ROS 2 node has on that middleware, and the same drops. */
#define _GNU_SOURCE
#include <dds/dds.h>
#include <stdlib.h>
#include <string.h>

#include "rmw.h"

/* So that the ledger knows whose numbers a message has of its publisher. */
#define IDENTIFIER "rmw_cyclonedds_cpp"

struct message {
  uint64_t number;
};

static const uint32_t operations[] = {DDS_OP_ADR | DDS_OP_TYPE_8BY, 0, DDS_OP_RTS};
static const dds_topic_descriptor_t type = {
    .m_size = sizeof(struct message),
    .m_align = 8,
    .m_flagset = DDS_TOPIC_FIXED_SIZE,
    .m_typename = "standin::message",
    .m_nops = 2,
    .m_ops = operations,
    .m_meta = "",
};

struct endpoint {
  const char *implementation;
  void *data;
  const char *topic_name;
  dds_entity_t entity, topic, condition; /* `data` begins with the first, as in rmw_cyclonedds_cpp */
  struct qos qos;
};

static struct endpoint *of_data(void *data) {
  return (struct endpoint *)((char *)data - offsetof(struct endpoint, entity));
}

static dds_entity_t participant(void) {
  static dds_entity_t made;
  if (made == 0) made = dds_create_participant(DDS_DOMAIN_DEFAULT, NULL, NULL);
  if (made < 0) abort();
  return made;
}

static struct endpoint *make(const char *name, const struct qos *qos, dds_qos_t *wanted) {
  struct endpoint *made = calloc(1, sizeof *made);
  char topic[600] = "rt";
  made->implementation = IDENTIFIER;
  made->data = &made->entity;
  made->qos = *qos;
  made->topic_name = strdup(name);
  made->topic = dds_create_topic(participant(), &type, strcat(topic, name), NULL, NULL);
  if (made->topic < 0) abort();
  dds_qset_history(wanted, qos->history == 2 ? DDS_HISTORY_KEEP_ALL : DDS_HISTORY_KEEP_LAST,
                   (int32_t)qos->depth);
  dds_qset_reliability(
      wanted, qos->reliability == 1 ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
      DDS_SECS(10));
  return made;
}

void *rmw_create_subscription(const void *node, const void *ts, const char *topic,
                              const struct qos *qos, const void *options) {
  (void)node, (void)ts, (void)options;
  dds_qos_t *wanted = dds_create_qos();
  struct endpoint *made = make(topic, qos, wanted);
  made->entity = dds_create_reader(participant(), made->topic, wanted, NULL);
  made->condition = dds_create_readcondition(made->entity, DDS_ANY_STATE);
  dds_delete_qos(wanted);
  return made;
}

void *rmw_create_publisher(const void *node, const void *ts, const char *topic,
                           const struct qos *qos, const void *options) {
  (void)node, (void)ts, (void)options;
  dds_qos_t *wanted = dds_create_qos();
  struct endpoint *made = make(topic, qos, wanted);
  made->entity = dds_create_writer(participant(), made->topic, wanted, NULL);
  dds_delete_qos(wanted);
  return made;
}

int rmw_destroy_subscription(void *node, void *subscription) {
  (void)node;
  struct endpoint *gone = subscription;
  dds_delete(gone->entity);
  dds_delete(gone->topic);
  free((char *)gone->topic_name);
  free(gone);
  return 0;
}

int rmw_destroy_publisher(void *node, void *publisher) {
  return rmw_destroy_subscription(node, publisher);
}

int rmw_subscription_get_actual_qos(const void *subscription, struct qos *qos) {
  *qos = ((const struct endpoint *)subscription)->qos;
  return 0;
}

int rmw_publisher_get_actual_qos(const void *publisher, struct qos *qos) {
  return rmw_subscription_get_actual_qos(publisher, qos);
}

int rmw_subscription_count_matched_publishers(const void *subscription, size_t *publishers) {
  int matched = dds_get_matched_publications(((const struct endpoint *)subscription)->entity, NULL, 0);
  *publishers = matched < 0 ? 0 : (size_t)matched;
  return matched < 0;
}

int rmw_publisher_count_matched_subscriptions(const void *publisher, size_t *subscriptions) {
  int matched = dds_get_matched_subscriptions(((const struct endpoint *)publisher)->entity, NULL, 0);
  *subscriptions = matched < 0 ? 0 : (size_t)matched;
  return matched < 0;
}

int rmw_publish(const void *publisher, const void *message, void *allocation) {
  (void)allocation;
  return dds_write(((const struct endpoint *)publisher)->entity, message) < 0;
}

int rmw_publish_serialized_message(const void *publisher, const void *message, void *allocation) {
  return rmw_publish(publisher, ((const struct serialized *)message)->buffer, allocation);
}

int rmw_publish_loaned_message(const void *publisher, void *message, void *allocation) {
  return rmw_publish(publisher, message, allocation);
}

int rmw_take_with_info(const void *subscription, void *message, bool *taken, void *info,
                       void *allocation) {
  (void)allocation;
  struct info *says = info;
  void *place[1] = {message};
  dds_sample_info_t sample;
  int many;
  do {
    many = dds_take(((const struct endpoint *)subscription)->entity, place, &sample, 1, 1);
  } while (many > 0 && !sample.valid_data); /* a writer that left */
  *taken = many > 0;
  if (*taken && says != NULL) {
    says->implementation = IDENTIFIER;
    says->source = sample.source_timestamp;
    memset(says->gid, 0, sizeof says->gid);
    memcpy(says->gid, &sample.publication_handle, sizeof sample.publication_handle);
  }
  return many < 0;
}

int rmw_take(const void *subscription, void *message, bool *taken, void *allocation) {
  return rmw_take_with_info(subscription, message, taken, NULL, allocation);
}

int rmw_take_serialized_message_with_info(const void *subscription, void *message, bool *taken,
                                          void *info, void *allocation) {
  struct serialized *into = message;
  into->length = sizeof(struct message);
  return rmw_take_with_info(subscription, into->buffer, taken, info, allocation);
}

int rmw_take_serialized_message(const void *subscription, void *message, bool *taken,
                                void *allocation) {
  return rmw_take_serialized_message_with_info(subscription, message, taken, NULL, allocation);
}

int rmw_take_loaned_message_with_info(const void *subscription, void **message, bool *taken,
                                      void *info, void *allocation) {
  static __thread struct message lent;
  *message = &lent;
  return rmw_take_with_info(subscription, &lent, taken, info, allocation);
}

int rmw_take_loaned_message(const void *subscription, void **message, bool *taken,
                            void *allocation) {
  return rmw_take_loaned_message_with_info(subscription, message, taken, NULL, allocation);
}

int rmw_take_sequence(const void *subscription, size_t count, void *messages, void *infos,
                      size_t *taken, void *allocation) {
  struct sequence *into = messages;
  bool any = true;
  for (*taken = 0; *taken < count; ++*taken) {
    rmw_take_with_info(subscription, into->data[*taken], &any, infos, allocation);
    if (!any) break;
  }
  into->size = *taken;
  return 0;
}

int rmw_trigger_guard_condition(const struct guard *guard) {
  (void)guard;
  return 1; /* here is none */
}

int rmw_destroy_guard_condition(struct guard *guard) {
  (void)guard;
  return 1;
}

int rmw_wait(struct set *wanted, struct set *guards, void *services, void *clients, void *events,
             void *wait_set, const struct span *timeout) {
  (void)guards, (void)services, (void)clients, (void)events, (void)wait_set;
  dds_entity_t waiting = dds_create_waitset(participant());
  for (size_t one = 0; one < wanted->count; one++) {
    struct endpoint *of = of_data(wanted->subscribers[one]);
    dds_waitset_attach(waiting, of->condition, 0);
  }
  dds_duration_t limit = DDS_INFINITY;
  if (timeout != NULL)
    limit = DDS_SECS((int64_t)timeout->seconds) + (int64_t)timeout->nanoseconds;
  int ready = dds_waitset_wait(waiting, NULL, 0, limit);
  for (size_t one = 0; one < wanted->count; one++) {
    struct endpoint *of = of_data(wanted->subscribers[one]);
    if (dds_triggered(of->condition) <= 0) wanted->subscribers[one] = NULL;
  }
  dds_delete(waiting);
  return ready > 0 ? 0 : 2;
}

uint64_t standin_overwritten(const void *subscription) {
  (void)subscription;
  return 0; /* Cyclone does not say, which is what the ledger is for */
}

uint64_t standin_waiting(const void *subscription) {
  return dds_triggered(((const struct endpoint *)subscription)->condition) > 0;
}

void standin_gid(const void *publisher, uint8_t gid[16]) {
  dds_guid_t guid;
  if (dds_get_guid(((const struct endpoint *)publisher)->entity, &guid) != 0) abort();
  memcpy(gid, &guid, sizeof guid);
}

void standin_match(const void *endpoint, bool subscription) {
  const struct endpoint *of = endpoint;
  uint32_t status = subscription ? DDS_SUBSCRIPTION_MATCHED_STATUS : DDS_PUBLICATION_MATCHED_STATUS;
  dds_set_status_mask(of->entity, status);
  dds_entity_t waiting = dds_create_waitset(participant());
  dds_waitset_attach(waiting, of->entity, 0);
  dds_waitset_wait(waiting, NULL, 0, DDS_SECS(20));
  dds_delete(waiting);
}

void standin_wire(uint16_t port, size_t bytes) { (void)port, (void)bytes, abort(); }
void standin_send(uint16_t port, size_t bytes) { (void)port, (void)bytes, abort(); }
