#define _GNU_SOURCE
#include "rcl.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int rcl_init_options_init(struct rcl_init_options *options, struct allocator allocator) {
  (void)allocator;
  options->impl = options;
  return RCL_OK;
}

int rcl_init(int argc, const char *const *argv, const struct rcl_init_options *options,
             struct rcl_context *context) {
  (void)argc, (void)argv;
  if (options->impl == NULL || context->impl != NULL)
    return standin_error(RCL_INVALID_ARGUMENT, "the context or its options are not as they should");
  struct rmw_context *made = calloc(1, sizeof *made);
  int failed = rmw_init(NULL, made);
  if (failed) free(made);
  else context->impl = made;
  return failed;
}

int rcl_shutdown(struct rcl_context *context) {
  return context->impl == NULL ? RCL_ERROR : RCL_OK;
}

int rcl_context_fini(struct rcl_context *context) {
  if (context->impl != NULL) rmw_context_fini(context->impl);
  free(context->impl);
  context->impl = NULL;
  return RCL_OK;
}

struct rcl_node_options rcl_node_get_default_options(void) {
  struct rcl_node_options options = {.allocator = rcutils_get_default_allocator()};
  return options;
}

bool rcl_is_name(const char *name, char between) {
  char before = between;
  for (; *name != 0; before = *name++) {
    bool begins = before == between;
    bool letter = *name == '_' || isalpha((unsigned char)*name);
    if (*name == between ? begins : !letter && (begins || !isdigit((unsigned char)*name)))
      return false;
  }
  return before != between;
}

int rcl_node_init(struct rcl_node *node, const char *name, const char *space,
                  struct rcl_context *context, const struct rcl_node_options *options) {
  char whole[512];
  if (options->allocator.allocate == NULL || context->impl == NULL)
    return standin_error(RCL_INVALID_ARGUMENT, "the node has no context or no allocator");
  if (!rcl_is_name(name, 0) || *name == 0)
    return standin_error(RCL_NODE_INVALID_NAME, "%s is no name of a node", name);
  snprintf(whole, sizeof whole, "%s%s", *space == '/' ? "" : "/", space);
  if (whole[1] != 0 && !rcl_is_name(whole + 1, '/'))
    return standin_error(RCL_NODE_INVALID_NAMESPACE, "%s is no namespace", space);
  node->impl = rmw_create_node(context->impl, name, whole);
  node->context = context;
  return node->impl == NULL ? RCL_ERROR : RCL_OK;
}

int rcl_node_fini(struct rcl_node *node) { return rmw_destroy_node(node->impl); }

struct rcl_endpoint_options rcl_publisher_get_default_options(void) {
  struct rcl_endpoint_options options = {
      .qos = {HISTORY_KEEP_LAST, 10, RELIABILITY_RELIABLE, DURABILITY_VOLATILE, {0, 0}, {0, 0}, 0,
              {0, 0}, false},
      .allocator = rcutils_get_default_allocator(),
  };
  return options;
}

struct rcl_endpoint_options rcl_subscription_get_default_options(void) {
  return rcl_publisher_get_default_options();
}

typedef struct rmw_endpoint *create(const struct rmw_node *, const struct type_support *,
                                    const char *, const struct rmw_qos *, const void *);

static int init(struct rcl_endpoint *made, const struct rcl_node *node,
                const struct type_support *type, const char *topic,
                const struct rcl_endpoint_options *options, create *make) {
  char whole[1024];
  if (type == NULL || made->impl != NULL || options->allocator.allocate == NULL)
    return standin_error(RCL_INVALID_ARGUMENT, "%s: no type, or it is initialized", topic);
  const char *space = node->impl->space;
  bool absolute = topic[0] == '/';
  snprintf(whole, sizeof whole, "%s%s%s", absolute ? "" : space,
           absolute || space[1] == 0 ? "" : "/", topic);
  if (!rcl_is_name(whole + 1, '/'))
    return standin_error(RCL_TOPIC_NAME_INVALID, "%s is no name of a topic", topic);
  made->impl = make(node->impl, type, whole, &options->qos, options->rmw);
  return made->impl == NULL ? RCL_ERROR : RCL_OK;
}

int rcl_publisher_init(struct rcl_endpoint *publisher, const struct rcl_node *node,
                       const struct type_support *type, const char *topic,
                       const struct rcl_endpoint_options *options) {
  return init(publisher, node, type, topic, options, rmw_create_publisher);
}

int rcl_subscription_init(struct rcl_endpoint *subscription, const struct rcl_node *node,
                          const struct type_support *type, const char *topic,
                          const struct rcl_endpoint_options *options) {
  return init(subscription, node, type, topic, options, rmw_create_subscription);
}

int rcl_publisher_fini(struct rcl_endpoint *publisher, struct rcl_node *node) {
  return rmw_destroy_publisher(node->impl, publisher->impl);
}

int rcl_subscription_fini(struct rcl_endpoint *subscription, struct rcl_node *node) {
  return rmw_destroy_subscription(node->impl, subscription->impl);
}

int rcl_publish_serialized_message(const struct rcl_endpoint *publisher,
                                   const struct serialized *message, void *allocation) {
  return rmw_publish_serialized_message(publisher->impl, message, allocation);
}

struct rmw_endpoint *rcl_publisher_get_rmw_handle(const struct rcl_endpoint *publisher) {
  return publisher->impl;
}

struct rmw_endpoint *rcl_subscription_get_rmw_handle(const struct rcl_endpoint *subscription) {
  return subscription->impl;
}

int rcl_publisher_get_subscription_count(const struct rcl_endpoint *publisher, size_t *count) {
  return rmw_publisher_count_matched_subscriptions(publisher->impl, count);
}

int rcl_subscription_get_publisher_count(const struct rcl_endpoint *subscription, size_t *count) {
  return rmw_subscription_count_matched_publishers(subscription->impl, count);
}

int rcl_take_serialized_message(const struct rcl_endpoint *subscription, struct serialized *message,
                                struct rmw_info *info, void *allocation) {
  bool taken = false;
  int failed = rmw_take_serialized_message_with_info(subscription->impl, message, &taken, info,
                                                     allocation);
  return failed || taken ? failed : RCL_SUBSCRIPTION_TAKE_FAILED;
}

int rcl_get_node_names(const struct rcl_node *node, struct allocator allocator,
                       struct strings *names, struct strings *spaces) {
  if (allocator.allocate == NULL) return standin_error(RCL_INVALID_ARGUMENT, "no allocator");
  return rmw_get_node_names(node->impl, names, spaces);
}

int rcl_get_topic_names_and_types(const struct rcl_node *node, struct allocator *allocator,
                                  bool mangled, struct names_and_types *into) {
  return rmw_get_topic_names_and_types(node->impl, allocator, mangled, into);
}

int rcl_get_publishers_info_by_topic(const struct rcl_node *node, struct allocator *allocator,
                                     const char *topic, bool mangled,
                                     struct endpoint_infos *into) {
  return rmw_get_publishers_info_by_topic(node->impl, allocator, topic, mangled, into);
}

int rcl_get_publisher_names_and_types_by_node(const struct rcl_node *node,
                                              struct allocator *allocator, bool mangled,
                                              const char *name, const char *space,
                                              struct names_and_types *into) {
  return rmw_get_publisher_names_and_types_by_node(node->impl, allocator, name, space, mangled,
                                                   into);
}

int rcl_get_subscriber_names_and_types_by_node(const struct rcl_node *node,
                                               struct allocator *allocator, bool mangled,
                                               const char *name, const char *space,
                                               struct names_and_types *into) {
  return rmw_get_subscriber_names_and_types_by_node(node->impl, allocator, name, space, mangled,
                                                    into);
}

int rcl_names_and_types_fini(struct names_and_types *of) {
  for (size_t one = 0; one < of->names.size; one++) rcutils_string_array_fini(&of->types[one]);
  free(of->types);
  return rcutils_string_array_fini(&of->names);
}
