/* Subscriptions, and the thread that takes what they receive and puts it into the ring. */
#define _GNU_SOURCE
#include <pthread.h>
#include <string.h>

#include "player.h"

/* Rounds of one subscription, so that a fast publisher does not keep the others waiting. */
#define ROUND 64
/* Somebody who triggers the guard is noticed at once; this bounds what a fault of that costs. */
#define LOOK_NS 500000000

struct subscription {
  bool made;
  bool live; /* it gives messages */
  struct blob rcl;
};

static struct subscription subscriptions[PLAYER_ENDPOINTS];
static pthread_mutex_t listing = PTHREAD_MUTEX_INITIALIZER; /* of `live` */
static struct blob guard;
static _Atomic bool guarded;
static struct serialized taken;

bool take_prepare(struct answer *into) {
  taken.allocator = rcl.rcutils_get_default_allocator();
  int failed = rcl.rcl_guard_condition_init(&guard, &context, taken.allocator);
  guarded = !failed;
  if (failed) answer_rcl(into, "rcl_guard_condition_init", failed);
  return guarded;
}

void take_wake(void) {
  if (guarded) (void)!rcl.rcl_trigger_guard_condition(&guard);
}

static void set_live(uint32_t slot, bool live) {
  pthread_mutex_lock(&listing);
  subscriptions[slot].live = live;
  pthread_mutex_unlock(&listing);
}

/* What this program publishes is none of what it subscribes to. The allocator, which is known, shows
 * whether the options are as long as they are taken to be. */
static void ignore_own(struct blob *options) {
  struct subscription_options known;
  memcpy(&known, options, sizeof known);
  if (memcmp(&known.allocator, &taken.allocator, sizeof taken.allocator) != 0) return;
  known.ignore_local_publications = true;
  memcpy(options, &known, sizeof known);
}

void subscription_add(const struct wanted *wanted, struct answer *into) {
  struct blob *made = &subscriptions[wanted->slot].rcl;
  struct blob options = rcl.rcl_subscription_get_default_options();
  qos_into(&options, &wanted->qos);
  if (wanted->others) ignore_own(&options);
  memset(made, 0, sizeof *made);
  int failed = rcl.rcl_subscription_init(made, &node, wanted->type, wanted->topic, &options);
  if (failed) {
    answer_rcl(into, "rcl_subscription_init", failed);
    return;
  }
  subscriptions[wanted->slot].made = true;
  set_live(wanted->slot, true);
  take_wake();
  answer_number(into, STATUS_DONE);
}

void subscription_matched(uint32_t slot, struct answer *into) {
  if (!subscriptions[slot].made) {
    answer_failed(into, STATUS_REQUEST, "there is no such subscription");
    return;
  }
  size_t count = 0;
  int failed = rcl.rcl_subscription_get_publisher_count(&subscriptions[slot].rcl, &count);
  if (failed) {
    answer_rcl(into, "rcl_subscription_get_publisher_count", failed);
    return;
  }
  answer_number(into, STATUS_DONE);
  answer_long(into, count);
}

/* Takes a round of messages; false at the end. */
static bool take(uint32_t slot) {
  for (int round = 0; round < ROUND; round++) {
    struct blob info; /* begins with the source's stamp */
    int64_t stamp = 0;
    int returned =
        rcl.rcl_take_serialized_message(&subscriptions[slot].rcl, &taken, &info, NULL);
    if (returned == RCL_TAKE_FAILED) {
      rcl.rcutils_reset_error();
      return true;
    }
    if (returned != RCL_OK) {
      char reason[1024];
      rcl_reason(reason, sizeof reason);
      set_live(slot, false);
      return in_write((uint16_t)slot, RECORD_FAILED, returned, reason, strlen(reason));
    }
    memcpy(&stamp, &info, sizeof stamp);
    bool fits = taken.length <= ring_most();
    bool written = fits
        ? in_write((uint16_t)slot, RECORD_MESSAGE, stamp, taken.buffer, taken.length)
        : in_write((uint16_t)slot, RECORD_TOO_LARGE, (int64_t)taken.length, NULL, 0);
    if (!written) return false;
    atomic_fetch_add(&memory->subscription[slot].taken, 1);
  }
  return true;
}

/* The subscriptions that give messages: their slots, and how many. */
static size_t list(uint32_t slots[PLAYER_ENDPOINTS]) {
  size_t count = 0;
  pthread_mutex_lock(&listing);
  for (uint32_t slot = 0; slot < PLAYER_ENDPOINTS; slot++)
    if (subscriptions[slot].live) slots[count++] = slot;
  pthread_mutex_unlock(&listing);
  return count;
}

/* Fills a wait set, which has room for `*room`; false if rcl can't. */
static bool fill(struct blob *set, size_t *room, const uint32_t *slots, size_t count) {
  if (*room != count) {
    if (*room != SIZE_MAX && rcl.rcl_wait_set_fini(set)) return false;
    memset(set, 0, sizeof *set);
    *room = SIZE_MAX;
    if (rcl.rcl_wait_set_init(set, count, 1, 0, 0, 0, 0, &context, taken.allocator)) return false;
    *room = count;
  }
  if (rcl.rcl_wait_set_clear(set)) return false;
  for (size_t one = 0; one < count; one++)
    if (rcl.rcl_wait_set_add_subscription(set, &subscriptions[slots[one]].rcl, NULL)) return false;
  return !rcl.rcl_wait_set_add_guard_condition(set, &guard, NULL);
}

/* Waits for messages and takes them; false at the end, or where rcl can't. */
static bool turn(struct blob *set, size_t *room) {
  static uint32_t slots[PLAYER_ENDPOINTS];
  size_t count = list(slots);
  if (!fill(set, room, slots, count)) return false;
  int returned = rcl.rcl_wait(set, LOOK_NS);
  if (returned == RCL_TIMEOUT) rcl.rcutils_reset_error();
  else if (returned != RCL_OK) return false;
  void **ready; /* the first member: what is not ready is NULL */
  memcpy(&ready, set, sizeof ready);
  for (size_t one = 0; one < count && returned == RCL_OK; one++)
    if (ready[one] != NULL && !take(slots[one])) return false;
  return true;
}

void *take_all(void *unused) {
  (void)unused;
  static struct blob set;
  size_t room = SIZE_MAX; /* not initialized */
  while (!atomic_load(&ending) && turn(&set, &room)) continue;
  if (!atomic_load(&ending)) {
    char reason[1024];
    rcl_reason(reason, sizeof reason);
    in_write(UINT16_MAX, RECORD_FAILED, 0, reason, strlen(reason));
  }
  if (room != SIZE_MAX) (void)!rcl.rcl_wait_set_fini(&set);
  thread_ends();
  return NULL;
}

void subscriptions_end(void) {
  for (uint32_t slot = 0; slot < PLAYER_ENDPOINTS; slot++)
    if (subscriptions[slot].made)
      (void)!rcl.rcl_subscription_fini(&subscriptions[slot].rcl, &node);
  if (guarded) (void)!rcl.rcl_guard_condition_fini(&guard);
}
