/* Subscriptions, and the thread that takes what they receive and puts it into the ring. */
#define _GNU_SOURCE
#include <pthread.h>
#include <string.h>

#include "player.h"

/* Rounds of one subscription, so that a fast publisher does not keep the others waiting. */
#define ROUND 64

static bool made[PLAYER_ENDPOINTS];
static bool live[PLAYER_ENDPOINTS]; /* it gives messages */
static pthread_mutex_t listing = PTHREAD_MUTEX_INITIALIZER; /* of `live` */

static void set_live(uint32_t slot, bool now) {
  pthread_mutex_lock(&listing);
  live[slot] = now;
  pthread_mutex_unlock(&listing);
}

void subscription_add(const struct wanted *wanted, struct answer *into) {
  if (!subscription_make(wanted, into)) return;
  made[wanted->slot] = true;
  set_live(wanted->slot, true);
  messages_wake();
  answer_number(into, STATUS_DONE);
}

void subscription_matched(uint32_t slot, struct answer *into) {
  uint64_t count = 0;
  if (!made[slot]) {
    answer_failed(into, STATUS_REQUEST, "there is no such subscription");
  } else if (subscription_count(slot, &count, into)) {
    answer_number(into, STATUS_DONE);
    answer_long(into, count);
  }
}

/* Hands over why a subscription, or all of them, gives no more; false at the end. */
static bool write_failure(uint16_t slot, int64_t number, const char *reason) {
  struct player_record record = {
      .length = (uint32_t)strlen(reason), .endpoint = slot, .kind = RECORD_FAILED, .stamp = number};
  return in_write(record, reason);
}

/* Hands over a message, or how long one is that no ring takes; false at the end. */
static bool write_message(uint16_t slot, const struct taken *taken) {
  struct player_record record = {.endpoint = slot};
  if (taken->length > ring_most()) {
    record.kind = RECORD_TOO_LARGE;
    record.stamp = (int64_t)taken->length;
    return in_write(record, NULL);
  }
  record.kind = RECORD_MESSAGE;
  record.length = (uint32_t)taken->length;
  record.stamp = taken->stamp;
  memcpy(record.publisher, taken->publisher, GID_BYTES);
  return in_write(record, taken->bytes);
}

/* Takes a round of messages; false at the end. */
static bool take(uint32_t slot) {
  for (int round = 0; round < ROUND; round++) {
    struct taken taken = {NULL, 0, 0, {0}};
    char reason[REASON_MOST] = "";
    switch (subscription_take(slot, &taken, reason)) {
      case TOOK_NOTHING: return true;
      case TOOK_TROUBLE:
        set_live(slot, false);
        return write_failure((uint16_t)slot, taken.stamp, reason);
      case TOOK_ONE: break;
    }
    if (!write_message((uint16_t)slot, &taken)) return false;
    atomic_fetch_add(&memory->subscription[slot].taken, 1);
  }
  return true;
}

/* The subscriptions that give messages: their slots, and how many. */
static size_t list(uint32_t slots[PLAYER_ENDPOINTS]) {
  size_t count = 0;
  pthread_mutex_lock(&listing);
  for (uint32_t slot = 0; slot < PLAYER_ENDPOINTS; slot++)
    if (live[slot]) slots[count++] = slot;
  pthread_mutex_unlock(&listing);
  return count;
}

/* Waits for messages and takes them; false at the end, or where the middleware can't. */
static bool turn(char reason[REASON_MOST]) {
  static uint32_t slots[PLAYER_ENDPOINTS];
  static bool ready[PLAYER_ENDPOINTS];
  size_t count = list(slots);
  memset(ready, 0, sizeof ready);
  if (!messages_wait(slots, count, ready, reason)) return false;
  for (size_t one = 0; one < count; one++)
    if (ready[one] && !take(slots[one])) return false;
  return true;
}

void *take_all(void *unused) {
  (void)unused;
  char reason[REASON_MOST] = "";
  while (!atomic_load(&ending) && turn(reason)) continue;
  if (!atomic_load(&ending)) write_failure(UINT16_MAX, 0, reason);
  messages_leave();
  thread_ends();
  return NULL;
}

void subscriptions_end(void) {
  for (uint32_t slot = 0; slot < PLAYER_ENDPOINTS; slot++)
    if (made[slot]) subscription_unmake(slot);
}
