/* The stand-in's rmw, as far as its client calls it. Every message is one 64-bit number. */
#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct qos {
  int history; /* 1 keep last, 2 keep all */
  size_t depth;
  int reliability;
  int durability;
  uint64_t others[8];
};
struct node {
  const char *implementation;
  void *data;
  const char *name, *name_space;
};
struct info {
  int64_t source, received;
  uint64_t publication, reception;
  const char *implementation;
  uint8_t gid[24];
  bool intra;
};
struct serialized {
  uint8_t *buffer;
  size_t length, capacity;
  void *allocator[5];
};
struct sequence {
  void **data;
  size_t size, capacity;
};
struct set {
  size_t count;
  void **subscribers;
};
struct guard {
  const char *implementation;
  void *data; /* here: whether it is triggered */
};
struct span {
  uint64_t seconds, nanoseconds;
};

void *rmw_create_subscription(const void *node, const void *type, const char *topic,
                              const struct qos *qos, const void *options);
void *rmw_create_publisher(const void *node, const void *type, const char *topic,
                           const struct qos *qos, const void *options);
int rmw_destroy_subscription(void *node, void *subscription);
int rmw_destroy_publisher(void *node, void *publisher);
int rmw_subscription_get_actual_qos(const void *subscription, struct qos *qos);
int rmw_publisher_get_actual_qos(const void *publisher, struct qos *qos);
int rmw_subscription_count_matched_publishers(const void *subscription, size_t *publishers);
int rmw_publisher_count_matched_subscriptions(const void *publisher, size_t *subscriptions);
int rmw_publish(const void *publisher, const void *message, void *allocation);
int rmw_publish_serialized_message(const void *publisher, const void *message, void *allocation);
int rmw_publish_loaned_message(const void *publisher, void *message, void *allocation);
int rmw_take(const void *subscription, void *message, bool *taken, void *allocation);
int rmw_take_with_info(const void *subscription, void *message, bool *taken, void *info,
                       void *allocation);
int rmw_take_serialized_message(const void *subscription, void *message, bool *taken,
                                void *allocation);
int rmw_take_serialized_message_with_info(const void *subscription, void *message, bool *taken,
                                          void *info, void *allocation);
int rmw_take_loaned_message(const void *subscription, void **message, bool *taken,
                            void *allocation);
int rmw_take_loaned_message_with_info(const void *subscription, void **message, bool *taken,
                                      void *info, void *allocation);
int rmw_take_sequence(const void *subscription, size_t count, void *messages, void *infos,
                      size_t *taken, void *allocation);
int rmw_wait(struct set *subscriptions, struct set *guards, void *services, void *clients,
             void *events, void *wait_set, const struct span *timeout);
int rmw_trigger_guard_condition(const struct guard *guard);
int rmw_destroy_guard_condition(struct guard *guard);

/* What only the stand-in has: a wait until somebody is at the other end, what a queue overwrote
 * (0 where the middleware does not say), what waits in it, and by what a message's publisher is known. And,
 * over memory alone: what is published goes to a port of loopback as well, in a datagram of so many bytes, and
 * publishers that are made from then on are Cyclone DDS'; and one such datagram that is no message. */
void standin_match(const void *endpoint, bool subscription);
uint64_t standin_overwritten(const void *subscription);
uint64_t standin_waiting(const void *subscription);
void standin_gid(const void *publisher, uint8_t gid[16]);
void standin_wire(uint16_t port, size_t bytes);
void standin_send(uint16_t port, size_t bytes);
