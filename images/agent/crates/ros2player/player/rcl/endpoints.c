/* Publishers and subscriptions of librcl, what is sent by them and taken. */
#include <stdio.h>
#include <string.h>

#include "layout.h"
#include "rcl.h"

static struct blob publishers[PLAYER_ENDPOINTS], subscriptions[PLAYER_ENDPOINTS];
static struct serialized buffer; /* of what was taken */

static struct rmw_time time_of(uint64_t nanoseconds) {
  return (struct rmw_time){nanoseconds / 1000000000, nanoseconds % 1000000000};
}

/* What is not asked for stays as rcl has it. */
static void qos_into(struct blob *options, const struct qos *qos) {
  struct rmw_qos head;
  memcpy(&head, options, sizeof head);
  head.history = qos->history;
  head.depth = qos->depth;
  head.reliability = qos->reliability;
  head.durability = qos->durability;
  if (qos->deadline > 0) head.deadline = time_of(qos->deadline);
  if (qos->lease > 0) head.lease = time_of(qos->lease);
  if (qos->manual) head.liveliness = LIVELINESS_MANUAL_BY_TOPIC;
  memcpy(options, &head, sizeof head);
}

bool publisher_make(const struct wanted *wanted, struct answer *into) {
  const void *type = rcl_type(wanted->package, wanted->folder, wanted->name, into);
  if (type == NULL) return false;
  struct blob *made = &publishers[wanted->slot];
  struct blob options = rcl.rcl_publisher_get_default_options();
  qos_into(&options, &wanted->qos);
  memset(made, 0, sizeof *made);
  cyclone_begin();
  int failed = rcl.rcl_publisher_init(made, &node, type, wanted->topic, &options);
  cyclone_end(wanted->slot, !failed);
  if (failed) answer_rcl(into, "rcl_publisher_init", failed);
  return !failed;
}

/* How rmw_gid_t begins; it is longer until Humble. */
struct gid {
  const char *implementation;
  uint8_t bytes[GID_BYTES];
  uint8_t rest[64];
};
typedef int get_gid(const void *publisher, struct gid *into);

/* Whether a message has its publisher's gid as the publisher has it, in nodes that take it: where this was
 * not run it is not believed. */
static bool is_in_messages(const char *implementation) {
  static const char *const those[] = {"rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp",
                                      "rmw_zenoh_cpp"};
  for (size_t one = 0; implementation != NULL && one < sizeof those / sizeof *those; one++)
    if (strcmp(implementation, those[one]) == 0) return true;
  return false;
}

/* In Cyclone DDS rmw's is a number of this process. */
bool publisher_gid(uint32_t slot, uint8_t gid[GID_BYTES]) {
  if (cyclone_made(slot)) return cyclone_guid(slot, gid);
  get_gid *get = (get_gid *)rcl_rmw_function("rmw_get_gid_for_publisher");
  const void *publisher = rcl.rcl_publisher_get_rmw_handle(&publishers[slot]);
  struct gid found;
  if (get == NULL || publisher == NULL || get(publisher, &found) != RCL_OK) return false;
  if (!is_in_messages(found.implementation)) return false;
  memcpy(gid, found.bytes, GID_BYTES);
  return true;
}

bool publisher_count(uint32_t slot, uint64_t *matched, struct answer *into) {
  size_t count = 0;
  int failed = rcl.rcl_publisher_get_subscription_count(&publishers[slot], &count);
  if (failed) answer_rcl(into, "rcl_publisher_get_subscription_count", failed);
  *matched = count;
  return !failed;
}

typedef int show(const void *publisher);

/* By the middleware's own function, which every distribution has: rcl's only looks at the handle first. */
void publisher_show(uint32_t slot) {
  /* Looked up once, as that takes the loader's lock; the two threads that do find the same. */
  static show *_Atomic assert_liveliness;
  if (assert_liveliness == NULL)
    assert_liveliness = (show *)rcl_rmw_function("rmw_publisher_assert_liveliness");
  const void *publisher = rcl.rcl_publisher_get_rmw_handle(&publishers[slot]);
  if (assert_liveliness != NULL && publisher != NULL) (void)!assert_liveliness(publisher);
}

bool publisher_send(uint32_t slot, const uint8_t *bytes, size_t length, bool more,
                    char reason[REASON_MOST]) {
  struct serialized message = {(uint8_t *)bytes, length, length,
                               rcl.rcutils_get_default_allocator()};
  int failed = rcl.rcl_publish_serialized_message(&publishers[slot], &message, NULL);
  if (failed) rcl_reason(reason, REASON_MOST);
  /* Also of those before it, if this one is refused. */
  if (!more) cyclone_flush(slot);
  return !failed;
}

void publisher_unmake(uint32_t slot) { (void)!rcl.rcl_publisher_fini(&publishers[slot], &node); }

/* What this program publishes is none of what it subscribes to. The allocator, which is known, shows
 * whether the options are as long as they are taken to be. */
static void ignore_own(struct blob *options) {
  struct allocator allocator = rcl.rcutils_get_default_allocator();
  struct subscription_options known;
  memcpy(&known, options, sizeof known);
  if (memcmp(&known.allocator, &allocator, sizeof allocator) != 0) return;
  known.ignore_local_publications = true;
  memcpy(options, &known, sizeof known);
}

bool subscription_make(const struct wanted *wanted, struct answer *into) {
  const void *type = rcl_type(wanted->package, wanted->folder, wanted->name, into);
  if (type == NULL) return false;
  struct blob *made = &subscriptions[wanted->slot];
  struct blob options = rcl.rcl_subscription_get_default_options();
  qos_into(&options, &wanted->qos);
  if (wanted->others) ignore_own(&options);
  memset(made, 0, sizeof *made);
  int failed = rcl.rcl_subscription_init(made, &node, type, wanted->topic, &options);
  if (failed) answer_rcl(into, "rcl_subscription_init", failed);
  return !failed;
}

bool subscription_count(uint32_t slot, uint64_t *matched, struct answer *into) {
  size_t count = 0;
  int failed = rcl.rcl_subscription_get_publisher_count(&subscriptions[slot], &count);
  if (failed) answer_rcl(into, "rcl_subscription_get_publisher_count", failed);
  *matched = count;
  return !failed;
}

/* By what a message says of its publisher: of Cyclone DDS, the handle that this process has of it. Another
 * distribution has that elsewhere: it is believed where the text that goes with it is the subscription's own. */
static void publisher_of(uint32_t slot, const struct message_info *info, uint8_t gid[GID_BYTES]) {
  const struct rmw_head *subscription = rcl.rcl_subscription_get_rmw_handle(&subscriptions[slot]);
  bool says = subscription != NULL && info->implementation != NULL &&
              info->implementation == subscription->implementation;
  if (!says) return;
  if (strcmp(info->implementation, "rmw_cyclonedds_cpp") == 0) {
    uint64_t handle;
    memcpy(&handle, info->gid, sizeof handle);
    cyclone_publisher(subscription, handle, gid);
  } else if (is_in_messages(info->implementation)) {
    memcpy(gid, info->gid, GID_BYTES);
  }
}

enum took subscription_take(uint32_t slot, struct taken *into, char reason[REASON_MOST]) {
  union {
    struct blob whole;
    struct message_info begin;
  } info;
  memset(&info.begin, 0, sizeof info.begin);
  if (buffer.allocator.allocate == NULL) buffer.allocator = rcl.rcutils_get_default_allocator();
  int returned = rcl.rcl_take_serialized_message(&subscriptions[slot], &buffer, &info, NULL);
  if (returned == RCL_TAKE_FAILED) {
    rcl.rcutils_reset_error();
    return TOOK_NOTHING;
  }
  if (returned != RCL_OK) {
    rcl_reason(reason, REASON_MOST);
    into->stamp = returned;
    return TOOK_TROUBLE;
  }
  into->bytes = buffer.buffer;
  into->length = buffer.length;
  into->stamp = info.begin.source;
  publisher_of(slot, &info.begin, into->publisher);
  return TOOK_ONE;
}

void subscription_unmake(uint32_t slot) {
  (void)!rcl.rcl_subscription_fini(&subscriptions[slot], &node);
}

const void *subscription_handle(uint32_t slot) { return &subscriptions[slot]; }
