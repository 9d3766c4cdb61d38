#define _GNU_SOURCE
#include "answer.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#define HEAD 8 /* length and sequence */

uint32_t request_number(struct request *from) {
  uint32_t number = 0;
  if (from->length - from->at < sizeof number) {
    from->wrong = true;
    return 0;
  }
  memcpy(&number, from->bytes + from->at, sizeof number);
  from->at += sizeof number;
  return number;
}

const char *request_text(struct request *from) {
  uint32_t length = request_number(from); /* with the 0 that ends it */
  const char *text = (const char *)from->bytes + from->at;
  if (length == 0 || length > from->length - from->at || text[length - 1] != 0) {
    from->wrong = true;
    return "";
  }
  from->at += length;
  return text;
}

static void put(struct answer *into, const void *bytes, size_t length) {
  if (into->capacity - into->length < length) {
    into->capacity = 2 * (into->length + length) + 4096;
    into->bytes = realloc(into->bytes, into->capacity);
    if (into->bytes == NULL) abort();
  }
  memcpy(into->bytes + into->length, bytes, length);
  into->length += length;
}

void answer_number(struct answer *into, uint32_t number) { put(into, &number, sizeof number); }

void answer_long(struct answer *into, uint64_t number) { put(into, &number, sizeof number); }

void answer_text(struct answer *into, const char *text) {
  uint32_t length = (uint32_t)strlen(text);
  answer_number(into, length);
  put(into, text, length);
}

void answer_gid(struct answer *into, const uint8_t *gid) {
  uint64_t halves[2] = {0, 0};
  if (gid != NULL) memcpy(halves, gid, sizeof halves);
  answer_number(into, gid != NULL);
  answer_long(into, halves[0]);
  answer_long(into, halves[1]);
}

void answer_begin(struct answer *into) {
  static const uint8_t head[HEAD];
  into->length = 0;
  put(into, head, sizeof head);
}

void answer_failed(struct answer *into, enum status status, const char *text) {
  answer_begin(into);
  answer_number(into, status);
  answer_text(into, text);
}

void answer_call(struct answer *into, const char *function, int returned, const char *reason) {
  answer_failed(into, STATUS_CALL, function);
  answer_number(into, (uint32_t)returned);
  answer_text(into, reason);
}

bool answer_send(struct answer *from, int socket, uint32_t sequence) {
  if (from->length > ANSWER_MOST) answer_failed(from, STATUS_REQUEST, "the answer is too long");
  uint32_t behind = (uint32_t)(from->length - sizeof behind);
  memcpy(from->bytes, &behind, sizeof behind);
  memcpy(from->bytes + sizeof behind, &sequence, sizeof sequence);
  for (size_t sent = 0; sent < from->length;) {
    ssize_t some = send(socket, from->bytes + sent, from->length - sent, MSG_NOSIGNAL);
    if (some < 0 && errno == EINTR) continue;
    if (some <= 0) return false;
    sent += (size_t)some;
  }
  return true;
}
