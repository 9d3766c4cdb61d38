/* Lists the endpoints of a process in the ledger, and what stands for them: all of it under the
 * lock, which what counts never takes. */
#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "addresses.h"
#include "attach.h"
#include "layout.h"

struct rmw_time {
  uint64_t seconds, nanoseconds;
};
/* How rmw_qos_profile_t begins, in every distribution. */
struct qos_head {
  int history;
  size_t depth;
  int reliability;
  int durability;
  struct rmw_time deadline, lifespan;
  int liveliness;
  struct rmw_time lease;
};
#define LIVELINESS_MANUAL_BY_TOPIC 3

/* How rmw_node_t begins, likewise. */
struct node_head {
  const char *implementation;
  void *data;
  const char *name, *space;
};

/* How rmw_subscription_t and rmw_publisher_t do: a wait is given `data`. */
struct endpoint_head {
  const char *implementation;
  const void *data;
};

/* A subscription or publisher that was created. */
struct creation {
  enum ledger_kind kind;
  const struct endpoint_head *address; /* its rmw handle */
  const struct node_head *node;
  const char *topic;
  struct qos_head qos;
  uint64_t gid[2]; /* of a publisher (gid.h); 0 and 0: not known */
};

void list_endpoint(const struct creation *of);
/* The endpoint is about to be destroyed. */
void list_destroyed(const void *address);
/* `also` stands for what `known` stands for, with these flags from now on. */
void list_link(const void *known, const void *also, uint32_t flags);
/* A callback of an rclcpp subscription, which may be introduced only later. */
void list_callback(const void *subscription, const void *callback);
/* The rclcpp subscription of an rcl one. */
void list_introduced(const void *rcl, const void *subscription);

/* The endpoint that an address stands for, or NULL. */
static inline struct ledger_endpoint *listed(const void *address, uint32_t *slot) {
  uint32_t entry;
  struct ledger *ledger = attached(&entry);
  if (ledger == NULL) return NULL;
  *slot = address_find(address);
  return *slot == NO_SLOT ? NULL : &ledger->endpoint[*slot];
}
