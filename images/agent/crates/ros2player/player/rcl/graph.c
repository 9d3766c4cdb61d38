/* The nodes of the graph, with what they publish and subscribe to, and its topics. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "rcl.h"

typedef int by_node(const void *node, struct allocator *, bool mangled, const char *name,
                    const char *space, struct names_and_types *);

/* u32: how many; of each: its topic, its first type. Of a node that has left by now: none. */
static void topics(struct answer *into, by_node *get, const char *name, const char *space) {
  struct allocator allocator = rcl.rcutils_get_default_allocator();
  struct names_and_types found;
  memset(&found, 0, sizeof found);
  if (get(&node, &allocator, false, name, space, &found) != RCL_OK) {
    rcl.rcutils_reset_error();
    answer_number(into, 0);
    return;
  }
  answer_number(into, (uint32_t)found.names.size);
  for (size_t one = 0; one < found.names.size; one++) {
    const struct strings *types = &found.types[one];
    answer_text(into, found.names.data[one]);
    answer_text(into, types->size > 0 ? types->data[0] : "");
  }
  (void)!rcl.rcl_names_and_types_fini(&found);
}

void middleware_graph(struct answer *into) {
  struct strings names, spaces;
  memset(&names, 0, sizeof names);
  memset(&spaces, 0, sizeof spaces);
  int failed =
      rcl.rcl_get_node_names(&node, rcl.rcutils_get_default_allocator(), &names, &spaces);
  if (failed) {
    answer_rcl(into, "rcl_get_node_names", failed);
    return;
  }
  answer_number(into, STATUS_DONE);
  answer_number(into, (uint32_t)names.size);
  for (size_t one = 0; one < names.size; one++) {
    answer_text(into, spaces.data[one]);
    answer_text(into, names.data[one]);
    topics(into, rcl.rcl_get_publisher_names_and_types_by_node, names.data[one], spaces.data[one]);
    topics(into, rcl.rcl_get_subscriber_names_and_types_by_node, names.data[one],
           spaces.data[one]);
  }
  (void)!rcl.rcutils_string_array_fini(&names);
  (void)!rcl.rcutils_string_array_fini(&spaces);
}

/* The topics of the whole graph: of two nodes of one name the lists by node show what one of them has. */
void middleware_topics(struct answer *into) {
  struct allocator allocator = rcl.rcutils_get_default_allocator();
  struct names_and_types found;
  memset(&found, 0, sizeof found);
  int failed = rcl.rcl_get_topic_names_and_types(&node, &allocator, false, &found);
  if (failed) {
    answer_rcl(into, "rcl_get_topic_names_and_types", failed);
    return;
  }
  answer_number(into, STATUS_DONE);
  answer_number(into, (uint32_t)found.names.size);
  for (size_t one = 0; one < found.names.size; one++) {
    answer_text(into, found.names.data[one]);
    const struct strings *types = &found.types[one];
    answer_number(into, (uint32_t)types->size);
    answer_text(into, types->size > 0 ? types->data[0] : "");
  }
  (void)!rcl.rcl_names_and_types_fini(&found);
}

/* The blocks that are asked for while a topic's endpoints are listed. */
struct blocks {
  struct block {
    void *at;
    size_t bytes;
  } *all;
  size_t count, room;
  bool listing; /* what is freed afterwards is of no interest */
};

static void forget(struct blocks *blocks, const void *at) {
  for (size_t one = blocks->count; blocks->listing && at != NULL && one-- > 0;)
    if (blocks->all[one].at == at) {
      blocks->all[one] = blocks->all[--blocks->count];
      return;
    }
}

static void *noted(void *at, size_t bytes, void *state) {
  struct blocks *blocks = state;
  if (at == NULL || !blocks->listing) return at;
  if (blocks->count == blocks->room) {
    size_t room = 2 * blocks->room + 16;
    struct block *more = realloc(blocks->all, room * sizeof *more);
    if (more == NULL) return at; /* the array is not found then, which is an error */
    blocks->all = more;
    blocks->room = room;
  }
  blocks->all[blocks->count++] = (struct block){at, bytes};
  return at;
}

static void *allocate(size_t bytes, void *state) { return noted(malloc(bytes), bytes, state); }

static void *zero_allocate(size_t count, size_t bytes, void *state) {
  return noted(calloc(count, bytes), count * bytes, state);
}

static void *reallocate(void *at, size_t bytes, void *state) {
  forget(state, at);
  return noted(realloc(at, bytes), bytes, state);
}

static void deallocate(void *at, void *state) {
  forget(state, at);
  free(at);
}

/* How long one of those listed is, by what their array took; 0 if that is not to be had. */
static size_t length_of_one(const struct endpoint_infos *found, const struct blocks *blocks) {
  size_t block = 0;
  while (block < blocks->count && blocks->all[block].at != found->first) block++;
  if (found->size == 0) return sizeof(struct endpoint_info);
  if (block == blocks->count) return 0;
  size_t bytes = blocks->all[block].bytes, one = bytes / found->size;
  bool whole = one * found->size == bytes && one % sizeof(void *) == 0;
  return whole && one >= sizeof(struct endpoint_info) ? one : 0;
}

/* NULL of a distribution that is not known. */
static const uint8_t *gid_of(const struct endpoint_info *one, size_t length) {
  switch (length) {
    case ENDPOINT_INFO_HUMBLE: return ((const struct endpoint_info_humble *)one)->gid;
    case ENDPOINT_INFO_IRON: return ((const struct endpoint_info_iron *)one)->gid;
    default: return NULL;
  }
}

void middleware_topic(const char *topic, struct answer *into) {
  struct blocks blocks = {.listing = true};
  struct allocator noting = {allocate, deallocate, reallocate, zero_allocate, &blocks};
  struct endpoint_infos found = {0, NULL};
  int failed = rcl.rcl_get_publishers_info_by_topic(&node, &noting, topic, false, &found);
  blocks.listing = false;
  size_t length = length_of_one(&found, &blocks);
  free(blocks.all);
  if (failed) {
    answer_rcl(into, "rcl_get_publishers_info_by_topic", failed);
    return;
  }
  if (length == 0) {
    answer_call(into, "rcl_get_publishers_info_by_topic", failed, "its array is none of ROS 2's");
  } else {
    answer_number(into, STATUS_DONE);
    answer_number(into, (uint32_t)found.size);
    for (size_t at = 0; at < found.size; at++) {
      const struct endpoint_info *one = (const void *)(found.first + at * length);
      answer_text(into, one->space == NULL ? "" : one->space);
      answer_text(into, one->node == NULL ? "" : one->node);
      answer_text(into, one->type == NULL ? "" : one->type);
      answer_gid(into, gid_of(one, length));
    }
  }
  (void)!rcl.rmw_topic_endpoint_info_array_fini(&found, &noting);
}
