/* The nodes of the graph, with what they publish and subscribe to, and its topics. */
#include <stdio.h>
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

static void types(struct answer *into, const struct names_and_types *found, const char *topic) {
  for (size_t one = 0; one < found->names.size; one++) {
    if (strcmp(found->names.data[one], topic) != 0) continue;
    const struct strings *types = &found->types[one];
    answer_number(into, (uint32_t)types->size);
    for (size_t at = 0; at < types->size; at++) answer_text(into, types->data[at]);
    return;
  }
  answer_number(into, 0);
}

/* Of the whole graph: of two nodes of one name the lists by node show what one of them has. */
void middleware_topic(const char *topic, struct answer *into) {
  struct allocator allocator = rcl.rcutils_get_default_allocator();
  struct names_and_types found;
  size_t publishers = 0;
  memset(&found, 0, sizeof found);
  int failed = rcl.rcl_count_publishers(&node, topic, &publishers);
  if (failed) {
    answer_rcl(into, "rcl_count_publishers", failed);
    return;
  }
  failed = rcl.rcl_get_topic_names_and_types(&node, &allocator, false, &found);
  if (failed) {
    answer_rcl(into, "rcl_get_topic_names_and_types", failed);
    return;
  }
  answer_number(into, STATUS_DONE);
  answer_long(into, publishers);
  types(into, &found, topic);
  (void)!rcl.rcl_names_and_types_fini(&found);
}
