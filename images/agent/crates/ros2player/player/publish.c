/* Publishers, and the thread that publishes what comes by the ring, from where it stands there. */
#define _GNU_SOURCE
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "player.h"

static _Atomic bool live[PLAYER_ENDPOINTS];
/* Why a publisher's last message was refused. */
static char reasons[PLAYER_ENDPOINTS][REASON_MOST];
static pthread_mutex_t reading = PTHREAD_MUTEX_INITIALIZER;

void publisher_add(const struct wanted *wanted, struct answer *into) {
  if (!publisher_make(wanted, into)) return;
  uint8_t gid[GID_BYTES];
  bool known = publisher_gid(wanted->slot, gid);
  atomic_store(&live[wanted->slot], true);
  if (!presence_add(wanted->slot, &wanted->qos)) {
    answer_failed(into, STATUS_REQUEST, "no thread is to be had");
    return;
  }
  answer_number(into, STATUS_DONE);
  answer_gid(into, known ? gid : NULL);
}

void publisher_matched(uint32_t slot, struct answer *into) {
  uint64_t count = 0;
  if (!atomic_load(&live[slot])) {
    answer_failed(into, STATUS_REQUEST, "there is no such publisher");
  } else if (publisher_count(slot, &count, into)) {
    answer_number(into, STATUS_DONE);
    answer_long(into, count);
  }
}

void publisher_refusal(uint32_t slot, struct answer *into) {
  answer_number(into, STATUS_DONE);
  pthread_mutex_lock(&reading);
  answer_text(into, reasons[slot]);
  pthread_mutex_unlock(&reading);
}

static void refuse(uint32_t slot, const char reason[REASON_MOST]) {
  pthread_mutex_lock(&reading);
  memcpy(reasons[slot], reason, REASON_MOST);
  pthread_mutex_unlock(&reading);
  atomic_fetch_add(&memory->publisher[slot].refused, 1);
  atomic_fetch_add(&memory->refused, 1);
}

static void publish(const struct player_record *record, const uint8_t *bytes) {
  uint32_t slot = record->endpoint;
  if (slot >= PLAYER_ENDPOINTS || !atomic_load(&live[slot])) return;
  char reason[REASON_MOST] = "";
  if (publisher_send(slot, bytes, record->length, out_follows(record->endpoint), reason))
    atomic_fetch_add(&memory->publisher[slot].published, 1);
  else
    refuse(slot, reason);
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
    if (atomic_exchange(&live[slot], false)) publisher_unmake(slot);
}
