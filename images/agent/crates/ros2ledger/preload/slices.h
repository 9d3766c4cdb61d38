/* One wait of a node as several short ones. */
#pragma once
#include <stddef.h>
#include <stdint.h>

#define SETS 5

/* rmw_subscriptions_t, rmw_guard_conditions_t, rmw_services_t, rmw_clients_t, rmw_events_t: in all
 * of them a wait writes NULL over each thing that is not ready. */
struct set {
  size_t count;
  void **things;
};
/* rmw_time_t. */
struct span {
  uint64_t seconds, nanoseconds;
};
typedef int rmw_wait_function(void *subscriptions, struct set *guards, void *services, void *clients,
                              void *events, void *wait_set, const void *timeout);

/* What the node calls rmw_wait with; NULL for a set that it has not. */
struct wait {
  rmw_wait_function *next;
  struct set *set[SETS];
  void *wait_set;
  const struct span *timeout; /* NULL: without end */
};

/* The same result, and the same things ready, as one call of `next` gives; between its slices the
 * matches are sampled, for as long as somebody watches. */
int wait_in_slices(const struct wait *wait);
