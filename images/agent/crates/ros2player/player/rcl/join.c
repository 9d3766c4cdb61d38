/* Joins the graph by librcl, and leaves it. */
#include <string.h>

#include "rcl.h"

struct blob context, node;

static bool with_context, with_node;

static bool load(struct answer *into) {
  bool symbol;
  const char *missing = rcl_load(&symbol);
  if (missing != NULL) answer_failed(into, symbol ? STATUS_SYMBOL : STATUS_LIBRARY, missing);
  return missing == NULL;
}

static bool make_node(const char *name, const char *space, struct answer *into) {
  struct blob options;
  memset(&options, 0, sizeof options);
  int failed = rcl.rcl_init_options_init(&options, rcl.rcutils_get_default_allocator());
  if (failed) {
    answer_rcl(into, "rcl_init_options_init", failed);
    return false;
  }
  failed = rcl.rcl_init(0, NULL, &options, &context);
  if (failed) {
    answer_rcl(into, "rcl_init", failed);
    return false;
  }
  with_context = true;
  struct blob node_options = rcl.rcl_node_get_default_options();
  failed = rcl.rcl_node_init(&node, name, space, &context, &node_options);
  if (failed) answer_rcl(into, "rcl_node_init", failed);
  with_node = !failed;
  return with_node;
}

bool middleware_join(const char *name, const char *space, struct answer *into) {
  return load(into) && make_node(name, space, into) && take_prepare(into);
}

void middleware_leave(void) {
  take_unprepare();
  states_leave();
  if (with_node) (void)!rcl.rcl_node_fini(&node);
  if (with_context && rcl.rcl_shutdown(&context) == RCL_OK)
    (void)!rcl.rcl_context_fini(&context);
}
