/* Waits for messages by a wait set of librcl. */
#include <string.h>

#include "rcl.h"

/* Somebody who triggers the guard is noticed at once; this bounds what a fault of that costs. */
#define LOOK_NS 500000000
#define NO_SET SIZE_MAX

static struct blob guard, set;
static _Atomic bool guarded;
static size_t room = NO_SET; /* of the set */

bool take_prepare(struct answer *into) {
  int failed =
      rcl.rcl_guard_condition_init(&guard, &context, rcl.rcutils_get_default_allocator());
  guarded = !failed;
  if (failed) answer_rcl(into, "rcl_guard_condition_init", failed);
  return guarded;
}

void take_unprepare(void) {
  if (guarded) (void)!rcl.rcl_guard_condition_fini(&guard);
}

void messages_wake(void) {
  if (guarded) (void)!rcl.rcl_trigger_guard_condition(&guard);
}

/* Fills the wait set; false if rcl can't. */
static bool fill(const uint32_t *slots, size_t count) {
  if (room != count) {
    if (room != NO_SET && rcl.rcl_wait_set_fini(&set)) return false;
    memset(&set, 0, sizeof set);
    room = NO_SET;
    if (rcl.rcl_wait_set_init(&set, count, 1, 0, 0, 0, 0, &context,
                              rcl.rcutils_get_default_allocator()))
      return false;
    room = count;
  }
  if (rcl.rcl_wait_set_clear(&set)) return false;
  for (size_t one = 0; one < count; one++)
    if (rcl.rcl_wait_set_add_subscription(&set, subscription_handle(slots[one]), NULL))
      return false;
  return !rcl.rcl_wait_set_add_guard_condition(&set, &guard, NULL);
}

bool messages_wait(const uint32_t *slots, size_t count, bool *ready, char reason[REASON_MOST]) {
  int returned = fill(slots, count) ? rcl.rcl_wait(&set, LOOK_NS) : -1;
  if (returned == RCL_TIMEOUT) rcl.rcutils_reset_error();
  else if (returned != RCL_OK) {
    rcl_reason(reason, REASON_MOST);
    return false;
  }
  void **found; /* the first member: what is not ready is NULL */
  memcpy(&found, &set, sizeof found);
  for (size_t one = 0; one < count && returned == RCL_OK; one++) ready[one] = found[one] != NULL;
  return true;
}

void messages_leave(void) {
  if (room != NO_SET) (void)!rcl.rcl_wait_set_fini(&set);
}
