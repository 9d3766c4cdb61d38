/* The stand-in's librcl.so: exactly the functions that the player uses, with the real arguments.
 * Structures are only as much of the real ones as their users see. */
#pragma once
#include "rmw.h"

#define RCL_OK 0
#define RCL_ERROR 1
#define RCL_TIMEOUT 2
#define RCL_INVALID_ARGUMENT 11
#define RCL_TOPIC_NAME_INVALID 103
#define RCL_NODE_INVALID_NAME 201
#define RCL_NODE_INVALID_NAMESPACE 202
#define RCL_SUBSCRIPTION_TAKE_FAILED 401
#define RCL_SERVICE_NAME_INVALID 104
#define RCL_CLIENT_TAKE_FAILED 501
#define RCL_WAIT_SET_EMPTY 901
#define RCL_WAIT_SET_FULL 902

struct rcl_init_options {
  void *impl;
};
struct rcl_context {
  void *arguments;
  struct rmw_context *impl;
  uint64_t instance;
};
struct rcl_node {
  struct rcl_context *context;
  struct rmw_node *impl;
};
struct rcl_node_options {
  size_t domain;
  struct allocator allocator;
  void *others[8];
};
/* Of publishers and subscriptions. */
struct rcl_endpoint_options {
  struct rmw_qos qos;
  struct allocator allocator;
  void *rmw[4];
};
struct rcl_endpoint {
  struct rmw_endpoint *impl;
};
struct rcl_client_options {
  struct rmw_qos qos;
  struct allocator allocator;
};
struct rcl_client {
  struct rmw_client *impl;
};
struct rcl_guard_options {
  struct allocator allocator;
};
struct rcl_guard {
  struct rcl_context *context;
  struct rmw_guard *impl;
};
struct rcl_wait_set {
  const struct rcl_endpoint **subscriptions;
  size_t subscription_count;
  const struct rcl_guard **guards;
  size_t guard_count;
  void *others[8];
  struct rcl_waiting *impl;
};

int rcl_init_options_init(struct rcl_init_options *options, struct allocator);
int rcl_init(int argc, const char *const *argv, const struct rcl_init_options *,
             struct rcl_context *);
int rcl_shutdown(struct rcl_context *context);
int rcl_context_fini(struct rcl_context *context);
struct rcl_node_options rcl_node_get_default_options(void);
int rcl_node_init(struct rcl_node *node, const char *name, const char *space, struct rcl_context *,
                  const struct rcl_node_options *);
int rcl_node_fini(struct rcl_node *node);

struct rcl_endpoint_options rcl_publisher_get_default_options(void);
int rcl_publisher_init(struct rcl_endpoint *publisher, const struct rcl_node *,
                       const struct type_support *, const char *topic,
                       const struct rcl_endpoint_options *);
int rcl_publisher_fini(struct rcl_endpoint *publisher, struct rcl_node *);
int rcl_publish_serialized_message(const struct rcl_endpoint *publisher, const struct serialized *,
                                   void *allocation);
struct rmw_endpoint *rcl_publisher_get_rmw_handle(const struct rcl_endpoint *publisher);
struct rmw_endpoint *rcl_subscription_get_rmw_handle(const struct rcl_endpoint *subscription);
int rcl_publisher_get_subscription_count(const struct rcl_endpoint *publisher, size_t *count);
struct rcl_endpoint_options rcl_subscription_get_default_options(void);
int rcl_subscription_init(struct rcl_endpoint *subscription, const struct rcl_node *,
                          const struct type_support *, const char *topic,
                          const struct rcl_endpoint_options *);
int rcl_subscription_fini(struct rcl_endpoint *subscription, struct rcl_node *);
int rcl_subscription_get_publisher_count(const struct rcl_endpoint *subscription, size_t *count);
int rcl_take_serialized_message(const struct rcl_endpoint *subscription, struct serialized *,
                                struct rmw_info *, void *allocation);

struct rcl_client_options rcl_client_get_default_options(void);
int rcl_client_init(struct rcl_client *client, const struct rcl_node *, const struct type_support *,
                    const char *service, const struct rcl_client_options *);
int rcl_client_fini(struct rcl_client *client, struct rcl_node *);
int rcl_service_server_is_available(const struct rcl_node *, const struct rcl_client *client,
                                    bool *available);
int rcl_send_request(const struct rcl_client *client, const void *request, int64_t *sequence);
int rcl_take_response(const struct rcl_client *client, struct rmw_request_id *, void *response);

int rcl_guard_condition_init(struct rcl_guard *guard, struct rcl_context *,
                             struct rcl_guard_options);
int rcl_guard_condition_fini(struct rcl_guard *guard);
int rcl_trigger_guard_condition(struct rcl_guard *guard);
int rcl_wait_set_init(struct rcl_wait_set *set, size_t subscriptions, size_t guards, size_t timers,
                      size_t clients, size_t services, size_t events, struct rcl_context *,
                      struct allocator);
int rcl_wait_set_fini(struct rcl_wait_set *set);
int rcl_wait_set_clear(struct rcl_wait_set *set);
int rcl_wait_set_add_subscription(struct rcl_wait_set *set, const struct rcl_endpoint *,
                                  size_t *index);
int rcl_wait_set_add_guard_condition(struct rcl_wait_set *set, const struct rcl_guard *,
                                     size_t *index);
int rcl_wait(struct rcl_wait_set *set, int64_t nanoseconds);

int rcl_get_node_names(const struct rcl_node *node, struct allocator, struct strings *names,
                       struct strings *spaces);
int rcl_get_topic_names_and_types(const struct rcl_node *node, struct allocator *, bool mangled,
                                  struct names_and_types *into);
int rcl_get_publishers_info_by_topic(const struct rcl_node *node, struct allocator *,
                                     const char *topic, bool mangled,
                                     struct endpoint_infos *into);
int rcl_get_publisher_names_and_types_by_node(const struct rcl_node *node, struct allocator *,
                                              bool mangled, const char *name, const char *space,
                                              struct names_and_types *into);
int rcl_get_subscriber_names_and_types_by_node(const struct rcl_node *node, struct allocator *,
                                               bool mangled, const char *name, const char *space,
                                               struct names_and_types *into);
int rcl_names_and_types_fini(struct names_and_types *of);

/* What only the stand-in has: whether it is words of letters, digits and underscores, with `between`
 * between them. */
bool rcl_is_name(const char *name, char between);
