/* The functions of librmw_implementation.so, the same from Foxy to Rolling. What is only passed on
 * is a void pointer here. */
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#include "count.h"
#include "gid.h"
#include "guards.h"
#include "interpose.h"
#include "list.h"
#include "matches.h"
#include "origin.h"
#include "sending.h"
#include "slices.h"

#define RMW "librmw_implementation.so"
#define RMW_OK 0
#define RMW_ERROR 1

#define NEXT_RMW(name) NEXT(name, RMW, RMW_ERROR)

/* More than any rmw_qos_profile_t. */
union actual_qos {
  struct qos_head head;
  char room[1024];
};

typedef int get_actual_qos(const void *endpoint, void *qos);

/* The QoS as asked for; what was left to the middleware, as it chose. */
static struct qos_head chosen(const struct qos_head *asked, const void *endpoint,
                              const char *getter) {
  bool definite = (asked->history == 2 || (asked->history == 1 && asked->depth > 0)) &&
                  asked->reliability > 0 && asked->reliability < 3 && asked->durability > 0 &&
                  asked->durability < 3;
  if (definite) return *asked;
  get_actual_qos *get = (get_actual_qos *)next_function(getter, RMW);
  union actual_qos actual;
  memset(&actual, 0, sizeof actual);
  return get != NULL && get(endpoint, &actual) == RMW_OK ? actual.head : *asked;
}

PUBLIC void *rmw_create_subscription(const void *node, const void *type, const char *topic,
                                     const void *qos, const void *options) {
  NEXT(rmw_create_subscription, RMW, NULL)
  count_enter();
  void *made = next(node, type, topic, qos, options);
  if (count_leave() && made != NULL) {
    struct qos_head head = chosen(qos, made, "rmw_subscription_get_actual_qos");
    list_endpoint(&(struct creation){KIND_SUBSCRIPTION, made, node, topic, head, {0}});
  }
  return made;
}

PUBLIC void *rmw_create_publisher(const void *node, const void *type, const char *topic,
                                  const void *qos, const void *options) {
  NEXT(rmw_create_publisher, RMW, NULL)
  count_enter();
  void *made = next(node, type, topic, qos, options);
  if (count_leave() && made != NULL) {
    struct qos_head head = chosen(qos, made, "rmw_publisher_get_actual_qos");
    struct creation creation = {KIND_PUBLISHER, made, node, topic, head, {0}};
    if (!gid_of_publisher(made, (uint8_t *)creation.gid)) memset(creation.gid, 0, GID_BYTES);
    list_endpoint(&creation);
  }
  return made;
}

/* Both are forgotten before: the next one may get the same address from another thread. */
PUBLIC int rmw_destroy_subscription(void *node, void *subscription) {
  NEXT_RMW(rmw_destroy_subscription)
  list_destroyed(subscription);
  return next(node, subscription);
}

PUBLIC int rmw_destroy_publisher(void *node, void *publisher) {
  NEXT_RMW(rmw_destroy_publisher)
  list_destroyed(publisher);
  return next(node, publisher);
}

PUBLIC int rmw_wait(void *subscriptions, struct set *guards, void *services, void *clients, void *events,
                    void *wait_set, const void *timeout) {
  NEXT_RMW(rmw_wait)
  count_wait();
  struct awaited awaited;
  guards_wait(guards, &awaited);
  struct wait wait = {next, {subscriptions, guards, services, clients, events}, wait_set, timeout};
  int result = matches_watched() != 0
      ? wait_in_slices(&wait)
      : next(subscriptions, guards, services, clients, events, wait_set, timeout);
  guards_woken(guards, &awaited, result == RMW_OK);
  return result;
}

PUBLIC int rmw_trigger_guard_condition(const struct guard_head *guard) {
  NEXT_RMW(rmw_trigger_guard_condition)
  guard_triggered(guard);
  return next(guard);
}

PUBLIC int rmw_destroy_guard_condition(struct guard_head *guard) {
  NEXT_RMW(rmw_destroy_guard_condition)
  guard_destroyed(guard);
  return next(guard);
}

static void count_one(const struct endpoint_head *subscription, bool taken, uint64_t begun,
                      const struct message_info *info) {
  struct origin origin = {ORIGIN_UNKNOWN, 0};
  if (taken) origin = origin_of(subscription, info);
  count_take(subscription, taken ? 1 : 0, begun, origin);
}

/* A take of one message, with the arguments that come after `taken`; `info` has whose it is. */
#define TAKE(name, message, names, info, ...)                                             \
  PUBLIC int name(const void *subscription, message, bool *taken, __VA_ARGS__) {          \
    NEXT_RMW(name)                                                                        \
    uint64_t begun = count_moment();                                                      \
    count_enter();                                                                        \
    int result = next names;                                                              \
    if (count_leave() && result == RMW_OK) count_one(subscription, *taken, begun, info);  \
    return result;                                                                        \
  }

#define PLAIN (subscription, message, taken, allocation)
#define INFORMED (subscription, message, taken, info, allocation)

TAKE(rmw_take, void *message, PLAIN, NULL, void *allocation)
TAKE(rmw_take_with_info, void *message, INFORMED, info, void *info, void *allocation)
TAKE(rmw_take_serialized_message, void *message, PLAIN, NULL, void *allocation)
TAKE(rmw_take_serialized_message_with_info, void *message, INFORMED, info, void *info, void *allocation)
TAKE(rmw_take_loaned_message, void **message, PLAIN, NULL, void *allocation)
TAKE(rmw_take_loaned_message_with_info, void **message, INFORMED, info, void *info, void *allocation)
TAKE(rmw_take_dynamic_message, void *message, PLAIN, NULL, void *allocation)
TAKE(rmw_take_dynamic_message_with_info, void *message, INFORMED, info, void *info, void *allocation)

PUBLIC int rmw_take_sequence(const void *subscription, size_t count, void *messages, void *infos,
                             size_t *taken, void *allocation) {
  NEXT_RMW(rmw_take_sequence)
  uint64_t begun = count_moment();
  count_enter();
  int result = next(subscription, count, messages, infos, taken, allocation);
  struct origin unknown = {ORIGIN_UNKNOWN, 0};
  if (count_leave() && result == RMW_OK) count_take(subscription, *taken, begun, unknown);
  return result;
}

#define PUBLISH(name, pointer)                                              \
  PUBLIC int name(const void *publisher, pointer message, void *allocation) { \
    NEXT_RMW(name)                                                          \
    count_enter();                                                          \
    struct offer offer = count_offer(publisher);                            \
    sending_begin(publisher);                                               \
    int result = next(publisher, message, allocation);                      \
    sending_end();                                                          \
    if (count_leave()) count_publish(offer, result == RMW_OK);              \
    return result;                                                          \
  }

PUBLISH(rmw_publish, const void *)
PUBLISH(rmw_publish_serialized_message, const void *)
PUBLISH(rmw_publish_loaned_message, void *)
