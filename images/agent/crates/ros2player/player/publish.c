/* Publishers, and the thread that publishes what comes by the ring, from where it stands there. */
#define _GNU_SOURCE
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "player.h"

struct publisher {
  _Atomic bool live;
  struct blob rcl;
};

static struct publisher publishers[PLAYER_ENDPOINTS];
/* Why a publisher's last message was refused. */
static char reasons[PLAYER_ENDPOINTS][512];
static pthread_mutex_t reading = PTHREAD_MUTEX_INITIALIZER;

void qos_into(struct blob *options, const struct qos *qos) {
  struct qos head;
  memcpy(&head, options, sizeof head);
  head.history = qos->history;
  head.depth = qos->depth;
  head.reliability = qos->reliability;
  head.durability = qos->durability;
  memcpy(options, &head, sizeof head);
}

void publisher_add(const struct wanted *wanted, struct answer *into) {
  struct publisher *made = &publishers[wanted->slot];
  struct blob options = rcl.rcl_publisher_get_default_options();
  qos_into(&options, &wanted->qos);
  memset(&made->rcl, 0, sizeof made->rcl);
  int failed = rcl.rcl_publisher_init(&made->rcl, &node, wanted->type, wanted->topic, &options);
  if (failed) {
    answer_rcl(into, "rcl_publisher_init", failed);
    return;
  }
  atomic_store(&made->live, true);
  answer_number(into, STATUS_DONE);
}

void publisher_matched(uint32_t slot, struct answer *into) {
  if (!atomic_load(&publishers[slot].live)) {
    answer_failed(into, STATUS_REQUEST, "there is no such publisher");
    return;
  }
  size_t count = 0;
  int failed = rcl.rcl_publisher_get_subscription_count(&publishers[slot].rcl, &count);
  if (failed) {
    answer_rcl(into, "rcl_publisher_get_subscription_count", failed);
    return;
  }
  answer_number(into, STATUS_DONE);
  answer_long(into, count);
}

void publisher_refusal(uint32_t slot, struct answer *into) {
  answer_number(into, STATUS_DONE);
  pthread_mutex_lock(&reading);
  answer_text(into, reasons[slot]);
  pthread_mutex_unlock(&reading);
}

static void refuse(uint32_t slot) {
  char reason[512];
  rcl_reason(reason, sizeof reason);
  pthread_mutex_lock(&reading);
  memcpy(reasons[slot], reason, sizeof reason);
  pthread_mutex_unlock(&reading);
  atomic_fetch_add(&memory->publisher[slot].refused, 1);
  atomic_fetch_add(&memory->refused, 1);
}

static void publish(const struct player_record *record, const uint8_t *bytes) {
  uint32_t slot = record->endpoint;
  if (slot >= PLAYER_ENDPOINTS || !atomic_load(&publishers[slot].live)) return;
  struct serialized message = {(uint8_t *)bytes, record->length, record->length,
                               rcl.rcutils_get_default_allocator()};
  if (rcl.rcl_publish_serialized_message(&publishers[slot].rcl, &message, NULL) == RCL_OK)
    atomic_fetch_add(&memory->publisher[slot].published, 1);
  else
    refuse(slot);
}

void *publish_all(void *unused) {
  (void)unused;
  const uint8_t *bytes;
  const struct player_record *record;
  while ((record = out_next(&bytes)) != NULL) {
    publish(record, bytes);
    out_done();
  }
  if (!atomic_load(&ending)) {
    fprintf(stderr, "ros2player: the ring of messages to publish is damaged\n");
    _exit(2);
  }
  thread_ends();
  return NULL;
}

void publishers_end(void) {
  for (uint32_t slot = 0; slot < PLAYER_ENDPOINTS; slot++)
    if (atomic_exchange(&publishers[slot].live, false))
      (void)!rcl.rcl_publisher_fini(&publishers[slot].rcl, &node);
}
