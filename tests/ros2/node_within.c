/* Messages within the process, as rclcpp hands them over: they wait in queues that no middleware has. */
#define _GNU_SOURCE
#include <stdlib.h>
#include <string.h>

#include "node.h"

static pthread_mutex_t queues = PTHREAD_MUTEX_INITIALIZER;

static struct message oldest(struct subscription *of) {
  struct message message = of->handed[of->first];
  of->first = (of->first + 1) % WITHIN;
  of->waiting--;
  return message;
}

void put_within(struct subscription *into, const uint8_t *bytes, size_t length) {
  struct message message = {malloc(length), length};
  if (message.data == NULL) abort();
  memcpy(message.data, bytes, length);
  pthread_mutex_lock(&queues);
  if (into->waiting == WITHIN) free(oldest(into).data);
  into->handed[(into->first + into->waiting++) % WITHIN] = message;
  pthread_mutex_unlock(&queues);
}

bool waits_within(struct subscription *of) {
  pthread_mutex_lock(&queues);
  bool waits = of->waiting > 0;
  pthread_mutex_unlock(&queues);
  return waits;
}

bool take_within(struct subscription *from, struct message *message) {
  pthread_mutex_lock(&queues);
  bool waits = from->waiting > 0;
  if (waits) *message = oldest(from);
  pthread_mutex_unlock(&queues);
  return waits;
}
