/* The thread that answers requests: one after the other, in their order. */
#define _GNU_SOURCE
#include <errno.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <unistd.h>

#include "player.h"

int control_socket;

static bool read_whole(void *into, size_t length) {
  for (size_t have = 0; have < length;) {
    ssize_t some = read(control_socket, (char *)into + have, length - have);
    if (some < 0 && errno == EINTR) continue;
    if (some <= 0) return false;
    have += (size_t)some;
  }
  return true;
}

/* The low half comes first. */
static uint64_t request_long(struct request *from) {
  uint64_t low = request_number(from);
  return (uint64_t)request_number(from) << 32 | low;
}

typedef void add(const struct wanted *, struct answer *);

static void create(struct request *from, struct answer *into, add *endpoint, bool others) {
  struct wanted wanted = {.slot = request_number(from), .others = others};
  wanted.topic = request_text(from);
  wanted.package = request_text(from);
  wanted.folder = request_text(from);
  wanted.name = request_text(from);
  wanted.qos.history = (int)request_number(from);
  wanted.qos.depth = request_number(from);
  wanted.qos.reliability = (int)request_number(from);
  wanted.qos.durability = (int)request_number(from);
  wanted.qos.deadline = request_long(from);
  wanted.qos.lease = request_long(from);
  wanted.qos.manual = request_number(from) != 0;
  if (from->wrong || wanted.slot >= PLAYER_ENDPOINTS)
    answer_failed(into, STATUS_REQUEST, "it is no endpoint");
  else
    endpoint(&wanted, into);
}

static void topic(struct request *from, struct answer *into) {
  const char *name = request_text(from);
  if (from->wrong) answer_failed(into, STATUS_REQUEST, "it names no topic");
  else middleware_topic(name, into);
}

static void obey(struct request *from, struct answer *into) {
  static bool started;
  uint32_t verb = request_number(from);
  answer_begin(into);
  if (started != (verb != VERB_START)) {
    answer_failed(into, STATUS_REQUEST, started ? "it runs already" : "it was not started");
    return;
  }
  uint32_t slot;
  const char *name = NULL;
  switch (verb) {
    case VERB_START:
      start(from, into);
      started = true;
      return;
    case VERB_ADVERTISE: create(from, into, publisher_add, false); return;
    case VERB_SUBSCRIBE: create(from, into, subscription_add, false); return;
    case VERB_LISTEN: create(from, into, subscription_add, true); return;
    case VERB_GRAPH: middleware_graph(into); return;
    case VERB_TOPICS: middleware_topics(into); return;
    case VERB_TOPIC: topic(from, into); return;
    case VERB_STATE:
      slot = request_number(from);
      name = request_text(from);
      break;
    default: slot = request_number(from);
  }
  if (from->wrong || slot >= PLAYER_ENDPOINTS)
    answer_failed(into, STATUS_REQUEST, "it names no endpoint");
  else if (verb == VERB_SUBSCRIBERS) publisher_matched(slot, into);
  else if (verb == VERB_PUBLISHERS) subscription_matched(slot, into);
  else if (verb == VERB_REFUSAL) publisher_refusal(slot, into);
  else if (verb == VERB_STATE && slot < PLAYER_STATES) node_state(slot, name, into);
  else answer_failed(into, STATUS_REQUEST, "it is no verb");
}

void *control(void *unused) {
  (void)unused;
  static uint8_t bytes[REQUEST_MOST];
  static struct answer answer;
  uint32_t length;
  while (read_whole(&length, sizeof length)) {
    if (length > sizeof bytes || !read_whole(bytes, length)) break;
    struct request request = {bytes, length, 0, false};
    uint32_t sequence = request_number(&request);
    obey(&request, &answer);
    if (!answer_send(&answer, control_socket, sequence)) break;
  }
  shutdown(control_socket, SHUT_RDWR); /* which the main thread notices, if it is not the reason */
  thread_ends();
  return NULL;
}
