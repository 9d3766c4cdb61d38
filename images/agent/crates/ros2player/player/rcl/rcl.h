/* librcl as any distribution from Foxy to Rolling has it. Its structures differ between them, so
 * that they are blobs of more room than any needs; what is read or set of them begins alike in all.
 * What is longer than 16 bytes is returned through a hidden pointer, whatever its length. */
#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "middleware.h"

#define RCL_OK 0
#define RCL_TIMEOUT 2
#define LIVELINESS_MANUAL_BY_TOPIC 3 /* rmw's */
#define RCL_TAKE_FAILED 401 /* there was nothing */

struct blob {
  _Alignas(16) char bytes[4096];
};
struct allocator {
  void *(*allocate)(size_t size, void *state);
  void (*deallocate)(void *pointer, void *state);
  void *(*reallocate)(void *pointer, size_t size, void *state);
  void *(*zero_allocate)(size_t count, size_t size, void *state);
  void *state;
};
struct serialized {
  uint8_t *buffer;
  size_t length, capacity;
  struct allocator allocator;
};
struct rmw_time {
  uint64_t seconds, nanoseconds;
};
/* rmw_qos_profile_t. */
struct rmw_qos {
  int history;
  size_t depth;
  int reliability, durability;
  struct rmw_time deadline, lifespan;
  int liveliness;
  struct rmw_time lease;
  bool without_prefixes;
};
/* The options of both kinds of endpoint begin with the quality of service: a subscription's, up to what it says of its own node's publishers. */
struct subscription_options {
  struct rmw_qos qos;
  struct allocator allocator;
  void *payload;
  bool ignore_local_publications;
};
struct strings {
  size_t size;
  char **data;
  struct allocator allocator;
};
struct names_and_types {
  struct strings names;
  struct strings *types; /* for each name */
};

/* What rmw_subscription_t begins with. */
struct rmw_head {
  const char *implementation;
  void *data;
};
/* rmw_message_info_t, as far as it is read: since Humble. */
struct message_info {
  int64_t source, received;
  uint64_t publication, reception;
  const char *implementation;
  uint8_t gid[GID_BYTES];
};

/* rmw_topic_endpoint_info_array_t. How long one of them is differs between distributions. */
struct endpoint_infos {
  size_t size;
  char *first;
};
/* What rmw_topic_endpoint_info_t begins with in all of them. */
struct endpoint_info {
  const char *node, *space, *type;
};
/* The whole of it, but for its quality of service, by its length: until Humble, and since Iron. */
#define ENDPOINT_INFO_HUMBLE 144
#define ENDPOINT_INFO_IRON 168
struct endpoint_info_humble {
  struct endpoint_info head;
  int kind;
  uint8_t gid[24];
};
struct endpoint_info_iron {
  struct endpoint_info head;
  uint8_t type_hash[33];
  int kind;
  uint8_t gid[16];
};

/* Result, name, arguments; of guard conditions, the options are an allocator and nothing else. */
#define RCL_FUNCTIONS(X)                                                                           \
  X(struct allocator, rcutils_get_default_allocator, (void))                                       \
  X(struct blob, rcutils_get_error_string, (void))                                                 \
  X(void, rcutils_reset_error, (void))                                                             \
  X(int, rcutils_string_array_fini, (struct strings *))                                            \
  X(int, rcl_names_and_types_fini, (struct names_and_types *))                                     \
  X(int, rcl_init_options_init, (void *options, struct allocator))                                 \
  X(int, rcl_init, (int argc, const char *const *argv, const void *options, void *context))        \
  X(int, rcl_shutdown, (void *context))                                                            \
  X(int, rcl_context_fini, (void *context))                                                        \
  X(struct blob, rcl_node_get_default_options, (void))                                             \
  X(int, rcl_node_init, (void *node, const char *name, const char *space, void *context,           \
                         const void *options))                                                     \
  X(int, rcl_node_fini, (void *node))                                                              \
  X(struct blob, rcl_publisher_get_default_options, (void))                                        \
  X(int, rcl_publisher_init, (void *publisher, const void *node, const void *type,                 \
                              const char *topic, const void *options))                             \
  X(int, rcl_publisher_fini, (void *publisher, void *node))                                        \
  X(int, rcl_publish_serialized_message, (const void *publisher, const struct serialized *,        \
                                          void *allocation))                                       \
  X(const void *, rcl_publisher_get_rmw_handle, (const void *publisher))                           \
  X(int, rcl_publisher_get_subscription_count, (const void *publisher, size_t *count))             \
  X(struct blob, rcl_subscription_get_default_options, (void))                                     \
  X(int, rcl_subscription_init, (void *subscription, const void *node, const void *type,           \
                                 const char *topic, const void *options))                          \
  X(int, rcl_subscription_fini, (void *subscription, void *node))                                  \
  X(const void *, rcl_subscription_get_rmw_handle, (const void *subscription))                     \
  X(int, rcl_subscription_get_publisher_count, (const void *subscription, size_t *count))          \
  X(int, rcl_take_serialized_message, (const void *subscription, struct serialized *, void *info,  \
                                       void *allocation))                                          \
  X(struct blob, rcl_client_get_default_options, (void))                                           \
  X(int, rcl_client_init, (void *client, const void *node, const void *type, const char *service,  \
                           const void *options))                                                   \
  X(int, rcl_client_fini, (void *client, void *node))                                              \
  X(int, rcl_service_server_is_available, (const void *node, const void *client, bool *available)) \
  X(int, rcl_send_request, (const void *client, const void *request, int64_t *sequence))           \
  X(int, rcl_take_response, (const void *client, void *id, void *response))                        \
  X(int, rcl_guard_condition_init, (void *guard, void *context, struct allocator))                 \
  X(int, rcl_guard_condition_fini, (void *guard))                                                  \
  X(int, rcl_trigger_guard_condition, (void *guard))                                               \
  X(int, rcl_wait_set_init, (void *set, size_t subscriptions, size_t guards, size_t timers,        \
                             size_t clients, size_t services, size_t events, void *context,        \
                             struct allocator))                                                    \
  X(int, rcl_wait_set_fini, (void *set))                                                           \
  X(int, rcl_wait_set_clear, (void *set))                                                          \
  X(int, rcl_wait_set_add_subscription, (void *set, const void *subscription, size_t *index))      \
  X(int, rcl_wait_set_add_guard_condition, (void *set, const void *guard, size_t *index))          \
  X(int, rcl_wait, (void *set, int64_t nanoseconds))                                               \
  X(int, rcl_get_node_names, (const void *node, struct allocator, struct strings *names,           \
                              struct strings *spaces))                                             \
  X(int, rcl_get_publishers_info_by_topic, (const void *node, struct allocator *,                  \
                                            const char *topic, bool mangled,                       \
                                            struct endpoint_infos *))                              \
  X(int, rmw_topic_endpoint_info_array_fini, (struct endpoint_infos *, struct allocator *))        \
  X(int, rcl_get_topic_names_and_types, (const void *node, struct allocator *, bool mangled,       \
                                         struct names_and_types *))                                \
  X(int, rcl_get_publisher_names_and_types_by_node,                                                \
    (const void *node, struct allocator *, bool mangled, const char *name, const char *space,      \
     struct names_and_types *))                                                                    \
  X(int, rcl_get_subscriber_names_and_types_by_node,                                               \
    (const void *node, struct allocator *, bool mangled, const char *name, const char *space,      \
     struct names_and_types *))

#define RCL_POINTER(result, name, arguments) result(*name) arguments;
struct rcl {
  RCL_FUNCTIONS(RCL_POINTER)
};
extern struct rcl rcl;

/* Loads librcl.so with its functions; NULL, or what is missing: `*symbol` says whether that is the
 * name of a function, and not the loader's words. */
const char *rcl_load(bool *symbol);

/* A function of the middleware's; NULL if it has none of the name. */
void *rcl_rmw_function(const char *symbol);

/* The handle of a message type; NULL with an answer if its library is not there, or lacks it. */
const void *rcl_type(const char *package, const char *folder, const char *name,
                     struct answer *into);

/* The function of a package's library, loaded by its file's name; as above. */
void *rcl_function(const char *library, const char *symbol, struct answer *into);

extern struct blob context, node;

/* wait.c: what wakes who waits; false with an answer if it is not to be had. */
bool take_prepare(struct answer *into);
void take_unprepare(void);

/* states.c: its clients leave before the node does. */
void states_leave(void);

/* cyclone.c: the beginning and the end of the making of a publisher, which over Cyclone DDS may keep
 * messages back from then on; the sending of what it keeps; whether it is one of Cyclone's, and its
 * GUID there, or false. */
void cyclone_begin(void);
void cyclone_end(uint32_t slot, bool made);
void cyclone_flush(uint32_t slot);
bool cyclone_made(uint32_t slot);
bool cyclone_guid(uint32_t slot, uint8_t guid[GID_BYTES]);

/* The same of the publisher that a subscription of Cyclone DDS has under this handle; 0s where it has left. */
void cyclone_publisher(const struct rmw_head *subscription, uint64_t handle, uint8_t guid[GID_BYTES]);

/* endpoints.c */
const void *subscription_handle(uint32_t slot);

/* Answers that a function of rcl has failed, with rcl's reason. */
void answer_rcl(struct answer *into, const char *function, int returned);

/* rcl's text on what failed last in this thread, which is forgotten by it. */
void rcl_reason(char *into, size_t most);
