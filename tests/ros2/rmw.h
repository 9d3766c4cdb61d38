/* The stand-in's librmw_implementation.so: functions and structures as the real ones, as far as
 * nodes, the player and the ledger's library use them. A message that is not serialised is a
 * `struct message`, of whatever type. */
#pragma once
#include <stdbool.h>

#include "rcutils.h"

#define RMW_OK 0
#define RMW_ERROR 1
#define RMW_TIMEOUT 2
#define RMW_UNSUPPORTED 3
#define RMW_INVALID_ARGUMENT 11
#define RMW_NODE_NAME_NON_EXISTENT 203

enum { HISTORY_KEEP_LAST = 1, HISTORY_KEEP_ALL = 2 };
enum { RELIABILITY_RELIABLE = 1, RELIABILITY_BEST_EFFORT = 2 };
enum { DURABILITY_TRANSIENT_LOCAL = 1, DURABILITY_VOLATILE = 2 };
#define LIVELINESS_MANUAL_BY_TOPIC 3

struct rmw_time {
  uint64_t seconds, nanoseconds;
};
struct rmw_qos {
  int history; /* of each of these, 0 leaves it to the middleware */
  size_t depth;
  int reliability, durability;
  struct rmw_time deadline, lifespan;
  int liveliness;
  struct rmw_time lease;
  bool without_prefixes;
};
struct rmw_subscription_options {
  void *payload;
  bool ignore_local_publications;
};
struct rmw_context {
  const char *implementation;
  size_t domain;
  int32_t entity; /* Cyclone's of the domain */
  void *others[64];
};
struct rmw_node {
  const char *implementation;
  void *data;
  const char *name, *space;
  struct rmw_context *context;
};
/* Publishers too; wait sets have the `data` of subscriptions and guard conditions. */
struct rmw_endpoint {
  const char *implementation;
  void *data;
  const char *topic;
  void *options[4];
  bool can_lend;
};
struct rmw_client {
  const char *implementation;
  void *data;
  const char *name;
};
struct rmw_service {
  const char *implementation;
  void *data;
  const char *name;
};
struct rmw_guard {
  const char *implementation;
  void *data;
  struct rmw_context *context;
};
struct rmw_wait_set {
  const char *implementation;
  struct rmw_guard *guards;
  void *data;
};
struct rmw_things {
  size_t count;
  void **things;
};
struct rmw_info {
  int64_t source, received;
  uint64_t publication, reception;
  const char *implementation;
  uint8_t gid[24];
  bool intra;
};
struct serialized {
  uint8_t *buffer;
  size_t length, capacity;
  struct allocator allocator;
};
struct sequence {
  void **data;
  size_t size, capacity;
};
struct message {
  uint8_t *data; /* of malloc */
  size_t length;
};
/* What a library of types gives for a message. */
struct type_support {
  const char *identifier;
  const void *data; /* a `struct type_name` */
  const void *(*find)(const struct type_support *, const char *);
};
struct type_name {
  const char *package, *folder, *name;
};

/* The real one of lifecycle_msgs/srv/GetState: its label is not looked at. */
struct get_state_response {
  uint8_t id;
  char *label;
  size_t length, capacity;
};
struct rmw_request_id {
  uint8_t writer[16];
  int64_t sequence;
};
struct rmw_service_info {
  int64_t source, received;
  struct rmw_request_id id;
};

struct rmw_gid {
  const char *implementation;
  uint8_t bytes[24];
};

/* rmw_topic_endpoint_info_t, up to where the distributions differ. */
struct endpoint_info {
  char *node, *space, *type;
};
struct endpoint_infos {
  size_t size;
  char *first;
};

int rmw_init(const void *options, struct rmw_context *context);
int rmw_context_fini(struct rmw_context *context);
struct rmw_node *rmw_create_node(struct rmw_context *context, const char *name, const char *space);
int rmw_destroy_node(struct rmw_node *node);
int rmw_get_node_names(const struct rmw_node *node, struct strings *names, struct strings *spaces);
int rmw_get_topic_names_and_types(const struct rmw_node *node, struct allocator *, bool mangled,
                                  struct names_and_types *into);
int rmw_get_publishers_info_by_topic(const struct rmw_node *node, struct allocator *,
                                     const char *topic, bool mangled,
                                     struct endpoint_infos *into);
int rmw_topic_endpoint_info_array_fini(struct endpoint_infos *of, struct allocator *);
int rmw_get_publisher_names_and_types_by_node(const struct rmw_node *node, struct allocator *,
                                              const char *name, const char *space, bool mangled,
                                              struct names_and_types *into);
int rmw_get_subscriber_names_and_types_by_node(const struct rmw_node *node, struct allocator *,
                                               const char *name, const char *space, bool mangled,
                                               struct names_and_types *into);

struct rmw_endpoint *rmw_create_publisher(const struct rmw_node *node, const struct type_support *,
                                          const char *topic, const struct rmw_qos *,
                                          const void *options);
struct rmw_endpoint *rmw_create_subscription(const struct rmw_node *node,
                                             const struct type_support *, const char *topic,
                                             const struct rmw_qos *, const void *options);
int rmw_destroy_publisher(struct rmw_node *node, struct rmw_endpoint *publisher);
int rmw_destroy_subscription(struct rmw_node *node, struct rmw_endpoint *subscription);
int rmw_publisher_get_actual_qos(const struct rmw_endpoint *publisher, struct rmw_qos *into);
int rmw_subscription_get_actual_qos(const struct rmw_endpoint *subscription, struct rmw_qos *into);
/* For so many ms a new publisher knows no subscription, though these know it: one that matches late,
 * as Fast DDS' do. */
#define MEETS_LATE "STANDIN_MEETS_LATE_MS"
/* For so many ms a new subscription is in the graph, and who creates it does not have it yet. */
#define LISTS_LATE "STANDIN_LISTS_LATE_MS"
/* For so many us a call that publishes goes on after its message went out. */
#define RETURNS_LATE "STANDIN_RETURNS_LATE_US"
/* How a message that is taken has its publisher. Not set: as Cyclone DDS, by a handle of the process;
 * "gid": as other middlewares; "none": not at all. */
#define ORIGINS "STANDIN_ORIGINS"
int rmw_publisher_count_matched_subscriptions(const struct rmw_endpoint *publisher, size_t *into);
int rmw_subscription_count_matched_publishers(const struct rmw_endpoint *subscription,
                                              size_t *into);
int rmw_publish(const struct rmw_endpoint *publisher, const void *message, void *allocation);
int rmw_publish_serialized_message(const struct rmw_endpoint *publisher, const struct serialized *,
                                   void *allocation);
int rmw_publish_loaned_message(const struct rmw_endpoint *publisher, void *message,
                               void *allocation);

int rmw_get_gid_for_publisher(const struct rmw_endpoint *publisher, struct rmw_gid *into);
int rmw_publisher_assert_liveliness(const struct rmw_endpoint *publisher);
/* How often a publisher was taken for dead by a subscription of this process; over Cyclone DDS alone. */
__attribute__((weak)) unsigned long standin_deaths(void);
/* Of what this process publishes from now on so many are lost on the way; over Cyclone DDS alone. */
__attribute__((weak)) void standin_lose(uint64_t many);
int rmw_take(const struct rmw_endpoint *subscription, void *message, bool *taken, void *allocation);
/* Whether a message has come since the last take, which is not taken; over Cyclone DDS alone. */
__attribute__((weak)) bool standin_has_news(const struct rmw_endpoint *subscription);
int rmw_take_with_info(const struct rmw_endpoint *subscription, void *message, bool *taken,
                       struct rmw_info *info, void *allocation);
int rmw_take_serialized_message(const struct rmw_endpoint *subscription, struct serialized *,
                                bool *taken, void *allocation);
int rmw_take_serialized_message_with_info(const struct rmw_endpoint *subscription,
                                          struct serialized *, bool *taken, struct rmw_info *info,
                                          void *allocation);
int rmw_take_loaned_message(const struct rmw_endpoint *subscription, void **message, bool *taken,
                            void *allocation);
int rmw_take_loaned_message_with_info(const struct rmw_endpoint *subscription, void **message,
                                      bool *taken, struct rmw_info *info, void *allocation);
int rmw_take_sequence(const struct rmw_endpoint *subscription, size_t count, struct sequence *,
                      void *infos, size_t *taken, void *allocation);

/* Of the one service that there is, lifecycle_msgs/srv/GetState. */
struct rmw_client *rmw_create_client(const struct rmw_node *node, const struct type_support *,
                                     const char *name, const struct rmw_qos *);
int rmw_destroy_client(struct rmw_node *node, struct rmw_client *client);
int rmw_service_server_is_available(const struct rmw_node *node, const struct rmw_client *client,
                                    bool *available);
int rmw_send_request(const struct rmw_client *client, const void *request, int64_t *sequence);
int rmw_take_response(const struct rmw_client *client, struct rmw_service_info *info,
                      void *response, bool *taken);
struct rmw_service *rmw_create_service(const struct rmw_node *node, const struct type_support *,
                                       const char *name, const struct rmw_qos *);
int rmw_destroy_service(struct rmw_node *node, struct rmw_service *service);
int rmw_take_request(const struct rmw_service *service, struct rmw_service_info *info,
                     void *request, bool *taken);
int rmw_send_response(const struct rmw_service *service, struct rmw_request_id *id,
                      void *response);

struct rmw_guard *rmw_create_guard_condition(struct rmw_context *context);
int rmw_destroy_guard_condition(struct rmw_guard *guard);
int rmw_trigger_guard_condition(const struct rmw_guard *guard);
struct rmw_wait_set *rmw_create_wait_set(struct rmw_context *context, size_t most);
int rmw_destroy_wait_set(struct rmw_wait_set *set);
/* What is not ready becomes NULL in the things; without a timeout it waits for ever. */
int rmw_wait(struct rmw_things *subscriptions, struct rmw_things *guards,
             struct rmw_things *services, struct rmw_things *clients, struct rmw_things *events,
             struct rmw_wait_set *set, const struct rmw_time *timeout);
