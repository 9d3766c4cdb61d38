/* Publishers and subscriptions, over Cyclone's queues: what KEEP_LAST overwrites there is gone. */
#define _GNU_SOURCE
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "blob.h"
#include "rmw_parts.h"

#define ENCAPSULATION 4 /* bytes before each serialised message */

/* What is left to the middleware is as rmw_cyclonedds chooses. */
static struct rmw_qos chosen(const struct rmw_qos *asked) {
  struct rmw_qos qos = *asked;
  if (qos.history == 0) qos.history = HISTORY_KEEP_LAST;
  if (qos.depth == 0) qos.depth = 1;
  if (qos.reliability == 0) qos.reliability = RELIABILITY_RELIABLE;
  if (qos.durability == 0) qos.durability = DURABILITY_VOLATILE;
  return qos;
}

/* One that is not set, or beyond DDS' 31 bits of seconds, is without end. */
static dds_duration_t duration_of(struct rmw_time time) {
  bool endless = (time.seconds == 0 && time.nanoseconds == 0) || time.seconds >= INT32_MAX;
  return endless ? DDS_INFINITY : DDS_SECS((int64_t)time.seconds) + (int64_t)time.nanoseconds;
}

static dds_qos_t *dds_qos(const struct rmw_qos *qos) {
  dds_qos_t *made = dds_create_qos();
  bool all = qos->history == HISTORY_KEEP_ALL;
  dds_history_kind_t history = all ? DDS_HISTORY_KEEP_ALL : DDS_HISTORY_KEEP_LAST;
  int32_t depth = all ? DDS_LENGTH_UNLIMITED : (int32_t)qos->depth;
  dds_qset_history(made, history, depth);
  dds_qset_reliability(made,
                       qos->reliability == RELIABILITY_RELIABLE ? DDS_RELIABILITY_RELIABLE
                                                                : DDS_RELIABILITY_BEST_EFFORT,
                       DDS_INFINITY);
  if (qos->durability == DURABILITY_TRANSIENT_LOCAL) {
    dds_qset_durability(made, DDS_DURABILITY_TRANSIENT_LOCAL);
    dds_qset_durability_service(made, 0, history, depth, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED,
                                DDS_LENGTH_UNLIMITED);
  }
  bool manual = qos->liveliness == LIVELINESS_MANUAL_BY_TOPIC;
  dds_qset_deadline(made, duration_of(qos->deadline));
  dds_qset_liveliness(made, manual ? DDS_LIVELINESS_MANUAL_BY_TOPIC : DDS_LIVELINESS_AUTOMATIC,
                      duration_of(qos->lease));
  dds_qset_writer_data_lifecycle(made, false);
  dds_qset_ignorelocal(made, DDS_IGNORELOCAL_NONE);
  return made;
}

/* How often a publisher was taken for dead by a subscription of this process. */
static _Atomic unsigned long deaths;

static void note_liveliness(dds_entity_t reader, const dds_liveliness_changed_status_t status,
                            void *unused) {
  (void)reader;
  (void)unused;
  if (status.not_alive_count_change > 0) deaths += (unsigned long)status.not_alive_count_change;
}

static void watch_liveliness(dds_entity_t reader) {
  dds_listener_t *listener = dds_create_listener(NULL);
  dds_lset_liveliness_changed(listener, note_liveliness);
  dds_set_listener(reader, listener);
  dds_delete_listener(listener);
}

static struct rmw_endpoint *create(const struct rmw_node *node, const struct type_support *support,
                                   const char *topic, const struct rmw_qos *asked, bool reads,
                                   bool ignores_own) {
  dds_entity_t participant = ((const struct node *)node->data)->participant;
  const struct type_name *type = support->data;
  char dds_name[600], type_name[600];
  snprintf(dds_name, sizeof dds_name, "rt%s", topic);
  snprintf(type_name, sizeof type_name, "%s::%s::dds_::%s_", type->package, type->folder,
           type->name);
  struct endpoint *made = calloc(1, sizeof *made);
  made->qos = chosen(asked);
  made->topic = blob_topic(participant, dds_name, type_name, &made->type);
  dds_qos_t *qos = dds_qos(&made->qos);
  if (ignores_own) dds_qset_ignorelocal(qos, DDS_IGNORELOCAL_PARTICIPANT);
  made->entity = made->topic < 0 ? made->topic
                 : reads         ? dds_create_reader(participant, made->topic, qos, NULL)
                                 : dds_create_writer(participant, made->topic, qos, NULL);
  dds_delete_qos(qos);
  if (made->entity < 0) {
    standin_error(RMW_ERROR, "%s: %s", topic, dds_strretcode(made->entity));
    free(made);
    return NULL;
  }
  const char *late = reads ? NULL : getenv(MEETS_LATE);
  if (late != NULL) made->meets = dds_time() + DDS_MSECS(atoll(late));
  late = reads ? NULL : getenv(RETURNS_LATE);
  if (late != NULL) made->returns_late = DDS_USECS(atoll(late));
  if (reads) made->condition = dds_create_readcondition(made->entity, DDS_ANY_STATE);
  if (reads) watch_liveliness(made->entity);
  struct rmw_endpoint *endpoint = calloc(1, sizeof *endpoint);
  endpoint->implementation = is_set(ORIGINS, "gid")    ? "rmw_fastrtps_cpp"
                             : is_set(ORIGINS, "none") ? "rmw_standin"
                                                       : IDENTIFIER;
  endpoint->data = made;
  endpoint->topic = strdup(topic);
  return endpoint;
}

static int destroy(struct rmw_endpoint *endpoint) {
  struct endpoint *gone = endpoint->data;
  dds_delete(gone->entity);
  dds_delete(gone->topic);
  free(gone);
  free((char *)endpoint->topic);
  free(endpoint);
  return RMW_OK;
}

struct rmw_endpoint *rmw_create_publisher(const struct rmw_node *node,
                                          const struct type_support *type, const char *topic,
                                          const struct rmw_qos *qos, const void *options) {
  (void)options;
  return create(node, type, topic, qos, false, false);
}

struct rmw_endpoint *rmw_create_subscription(const struct rmw_node *node,
                                             const struct type_support *type, const char *topic,
                                             const struct rmw_qos *qos, const void *options) {
  const struct rmw_subscription_options *asked = options;
  bool ignores_own = asked != NULL && asked->ignore_local_publications;
  struct rmw_endpoint *made = create(node, type, topic, qos, true, ignores_own);
  const char *late = getenv(LISTS_LATE);
  if (late != NULL) dds_sleepfor(DDS_MSECS(atoll(late)));
  return made;
}

int rmw_destroy_publisher(struct rmw_node *node, struct rmw_endpoint *publisher) {
  (void)node;
  return destroy(publisher);
}

int rmw_destroy_subscription(struct rmw_node *node, struct rmw_endpoint *subscription) {
  (void)node;
  return destroy(subscription);
}

/* As Fast DDS gives it, or Cyclone DDS. */
int rmw_get_gid_for_publisher(const struct rmw_endpoint *publisher, struct rmw_gid *into) {
  const struct endpoint *of = publisher->data;
  dds_instance_handle_t handle = 0;
  memset(into, 0, sizeof *into);
  into->implementation = publisher->implementation;
  if (is_set(ORIGINS, "gid")) {
    dds_guid_t guid;
    dds_return_t failed = dds_get_guid(of->entity, &guid);
    if (failed) return standin_error(RMW_ERROR, "no GUID: %s", dds_strretcode(failed));
    memcpy(into->bytes, &guid, sizeof guid);
  } else if (dds_get_instance_handle(of->entity, &handle) == DDS_RETCODE_OK) {
    memcpy(into->bytes, &handle, sizeof handle);
  }
  return RMW_OK;
}

int rmw_publisher_assert_liveliness(const struct rmw_endpoint *publisher) {
  const struct endpoint *of = publisher->data;
  return dds_assert_liveliness(of->entity) == DDS_RETCODE_OK ? RMW_OK : RMW_ERROR;
}

unsigned long standin_deaths(void) { return deaths; }

int rmw_publisher_get_actual_qos(const struct rmw_endpoint *publisher, struct rmw_qos *into) {
  *into = ((const struct endpoint *)publisher->data)->qos;
  return RMW_OK;
}

int rmw_subscription_get_actual_qos(const struct rmw_endpoint *subscription,
                                    struct rmw_qos *into) {
  return rmw_publisher_get_actual_qos(subscription, into);
}

int rmw_publisher_count_matched_subscriptions(const struct rmw_endpoint *publisher, size_t *into) {
  const struct endpoint *of = publisher->data;
  dds_publication_matched_status_t status;
  dds_return_t failed = dds_get_publication_matched_status(of->entity, &status);
  if (failed) return standin_error(RMW_ERROR, "no count: %s", dds_strretcode(failed));
  *into = dds_time() < of->meets ? 0 : status.current_count;
  return RMW_OK;
}

int rmw_subscription_count_matched_publishers(const struct rmw_endpoint *subscription,
                                              size_t *into) {
  const struct endpoint *of = subscription->data;
  dds_subscription_matched_status_t status;
  dds_return_t failed = dds_get_subscription_matched_status(of->entity, &status);
  if (failed) return standin_error(RMW_ERROR, "no count: %s", dds_strretcode(failed));
  *into = status.current_count;
  return RMW_OK;
}

/* As a socket without room loses them. */
static _Atomic uint64_t lost_next;

void standin_lose(uint64_t many) { lost_next = many; }

static bool is_lost_on_its_way(void) {
  uint64_t left = lost_next;
  while (left > 0 && !atomic_compare_exchange_weak(&lost_next, &left, left - 1)) continue;
  return left > 0;
}

static int send_bytes(const struct rmw_endpoint *publisher, const uint8_t *bytes, size_t length) {
  const struct endpoint *of = publisher->data;
  if (length < ENCAPSULATION)
    return standin_error(RMW_ERROR, "%zu bytes are no serialised message", length);
  if (dds_time() < of->meets || is_lost_on_its_way()) return RMW_OK;
  dds_return_t failed = blob_write(of->entity, of->type, bytes, length);
  if (failed < 0)
    return standin_error(RMW_ERROR, "%s: %s", publisher->topic, dds_strretcode(failed));
  if (of->returns_late > 0) dds_sleepfor(of->returns_late);
  return RMW_OK;
}

int rmw_publish(const struct rmw_endpoint *publisher, const void *message, void *allocation) {
  (void)allocation;
  const struct message *from = message;
  return send_bytes(publisher, from->data, from->length);
}

int rmw_publish_serialized_message(const struct rmw_endpoint *publisher,
                                   const struct serialized *message, void *allocation) {
  (void)allocation;
  return send_bytes(publisher, message->buffer, message->length);
}

int rmw_publish_loaned_message(const struct rmw_endpoint *publisher, void *message,
                               void *allocation) {
  (void)publisher, (void)message, (void)allocation;
  return standin_error(RMW_UNSUPPORTED, "nothing is lent");
}

/* As most middlewares give it. */
static void put_guid(dds_entity_t reader, dds_instance_handle_t publisher, uint8_t gid[24]) {
  dds_builtintopic_endpoint_t *found = dds_get_matched_publication_data(reader, publisher);
  if (found == NULL) abort();
  memset(gid, 0, 24);
  memcpy(gid, &found->key, sizeof found->key);
  dds_builtintopic_free_endpoint(found);
}

/* Takes a message into memory that `grow` gives for its length. */
typedef uint8_t *grow(void *into, size_t length);

static int take(const struct rmw_endpoint *subscription, void *into, grow *room, bool *taken,
                struct rmw_info *info) {
  const struct endpoint *of = subscription->data;
  dds_sample_info_t sample;
  const uint8_t *bytes;
  size_t length;
  struct ddsi_serdata *found = blob_take(of->entity, &sample, &bytes, &length);
  *taken = found != NULL;
  if (found == NULL) return RMW_OK;
  memcpy(room(into, length), bytes, length);
  blob_release(found);
  if (info == NULL) return RMW_OK;
  memset(info, 0, sizeof *info);
  info->source = sample.source_timestamp;
  info->implementation = subscription->implementation;
  memcpy(info->gid, &sample.publication_handle, sizeof sample.publication_handle);
  if (is_set(ORIGINS, "none")) info->implementation = NULL;
  if (is_set(ORIGINS, "gid")) put_guid(of->entity, sample.publication_handle, info->gid);
  return RMW_OK;
}

static uint8_t *grow_message(void *into, size_t length) {
  struct message *message = into;
  message->data = realloc(message->data, length + 1);
  if (message->data == NULL) abort();
  message->length = length;
  return message->data;
}

static uint8_t *grow_serialized(void *into, size_t length) {
  struct serialized *message = into;
  const struct allocator *allocator = &message->allocator;
  if (message->capacity < length) {
    message->buffer = allocator->reallocate(message->buffer, length, allocator->state);
    if (message->buffer == NULL) abort();
    message->capacity = length;
  }
  message->length = length;
  return message->buffer;
}

bool standin_has_news(const struct rmw_endpoint *subscription) {
  uint32_t status = 0;
  dds_entity_t reader = ((const struct endpoint *)subscription->data)->entity;
  return dds_read_status(reader, &status, DDS_DATA_AVAILABLE_STATUS) == DDS_RETCODE_OK && status != 0;
}

int rmw_take_with_info(const struct rmw_endpoint *subscription, void *message, bool *taken,
                       struct rmw_info *info, void *allocation) {
  (void)allocation;
  return take(subscription, message, grow_message, taken, info);
}

int rmw_take(const struct rmw_endpoint *subscription, void *message, bool *taken,
             void *allocation) {
  return rmw_take_with_info(subscription, message, taken, NULL, allocation);
}

int rmw_take_serialized_message_with_info(const struct rmw_endpoint *subscription,
                                          struct serialized *message, bool *taken,
                                          struct rmw_info *info, void *allocation) {
  (void)allocation;
  return take(subscription, message, grow_serialized, taken, info);
}

int rmw_take_serialized_message(const struct rmw_endpoint *subscription, struct serialized *message,
                                bool *taken, void *allocation) {
  return rmw_take_serialized_message_with_info(subscription, message, taken, NULL, allocation);
}

int rmw_take_loaned_message_with_info(const struct rmw_endpoint *subscription, void **message,
                                      bool *taken, struct rmw_info *info, void *allocation) {
  (void)subscription, (void)message, (void)info, (void)allocation;
  *taken = false;
  return standin_error(RMW_UNSUPPORTED, "nothing is lent");
}

int rmw_take_loaned_message(const struct rmw_endpoint *subscription, void **message, bool *taken,
                            void *allocation) {
  return rmw_take_loaned_message_with_info(subscription, message, taken, NULL, allocation);
}

int rmw_take_sequence(const struct rmw_endpoint *subscription, size_t count,
                      struct sequence *messages, void *infos, size_t *taken, void *allocation) {
  (void)infos;
  bool any = true;
  for (*taken = 0; *taken < count; ++*taken) {
    rmw_take_with_info(subscription, messages->data[*taken], &any, NULL, allocation);
    if (!any) break;
  }
  messages->size = *taken;
  return RMW_OK;
}
