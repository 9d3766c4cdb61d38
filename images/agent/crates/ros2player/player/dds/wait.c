/* Waits for messages by a wait set of DDS, which grows with the subscriptions. */
#include <stdio.h>

#include "participant.h"

/* Somebody who triggers the guard is noticed at once; this bounds what a fault of that costs. */
#define LOOK DDS_MSECS(500)

static dds_entity_t set, guard;
static bool watched[PLAYER_ENDPOINTS]; /* in the set: of the thread that waits */

bool wait_prepare(struct answer *into) {
  set = dds_create_waitset(participant);
  if (set < 0) return answer_dds(into, "dds_create_waitset", set);
  guard = dds_create_guardcondition(participant);
  if (guard < 0) return answer_dds(into, "dds_create_guardcondition", guard);
  dds_return_t failed = dds_waitset_attach(set, guard, PLAYER_ENDPOINTS);
  return !failed || answer_dds(into, "dds_waitset_attach", failed);
}

void messages_wake(void) {
  if (guard > 0) (void)!dds_set_guardcondition(guard, true);
}

/* Watches these subscriptions and no others. */
static dds_return_t watch(const uint32_t *slots, size_t count) {
  size_t next = 0;
  for (uint32_t slot = 0; slot < PLAYER_ENDPOINTS; slot++) {
    bool wanted = next < count && slots[next] == slot;
    if (wanted) next++;
    if (wanted == watched[slot]) continue;
    dds_entity_t condition = subscription_condition(slot);
    dds_return_t failed = wanted ? dds_waitset_attach(set, condition, (dds_attach_t)slot)
                                 : dds_waitset_detach(set, condition);
    if (failed) return failed;
    watched[slot] = wanted;
  }
  return DDS_RETCODE_OK;
}

bool messages_wait(const uint32_t *slots, size_t count, bool *ready, char reason[REASON_MOST]) {
  static dds_attach_t found[PLAYER_ENDPOINTS + 1];
  dds_return_t some = watch(slots, count);
  if (some >= 0) some = dds_waitset_wait(set, found, PLAYER_ENDPOINTS + 1, LOOK);
  if (some < 0) {
    snprintf(reason, REASON_MOST, "dds_waitset_wait: %s", dds_strretcode(some));
    return false;
  }
  bool is_ready[PLAYER_ENDPOINTS] = {false};
  for (dds_return_t at = 0; at < some && at <= (dds_return_t)PLAYER_ENDPOINTS; at++) {
    if (found[at] >= 0 && found[at] < (dds_attach_t)PLAYER_ENDPOINTS) is_ready[found[at]] = true;
    else (void)!dds_set_guardcondition(guard, false);
  }
  for (size_t one = 0; one < count; one++) ready[one] = is_ready[slots[one]];
  return true;
}

void messages_leave(void) {}
