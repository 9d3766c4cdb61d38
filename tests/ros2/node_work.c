/* What a callback does: an answer that its input and its number decide, and nothing else. */
#define _GNU_SOURCE
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include "node.h"

#define HEADER 4 /* the encapsulation, before a message's fields */

static _Atomic uint64_t now; /* simulated, in ns */

/* Of the bytes and of the zeros that DDS sends after them up to a multiple of 4 (FNV-1a). */
static uint64_t hash(const struct message *of) {
  uint64_t value = 0xcbf29ce484222325ull;
  for (size_t at = 0; at < (of->length + 3) / 4 * 4; at++)
    value = (value ^ (at < of->length ? of->data[at] : 0)) * 0x100000001b3ull;
  return value;
}

static uint32_t number_at(const struct message *of, size_t at) {
  uint32_t number = 0;
  if (of->length >= HEADER + at + 4) memcpy(&number, of->data + HEADER + at, 4);
  return number;
}

void set_time(const struct message *clock) {
  now = number_at(clock, 0) * 1000000000ull + number_at(clock, 4);
}

/* Each message begins with the encapsulation of little-endian CDR. */
static uint8_t *begin(uint8_t *bytes) {
  static const uint8_t little_endian[HEADER] = {0, 1, 0, 0};
  memcpy(bytes, little_endian, HEADER);
  return bytes + HEADER;
}

/* This text, with points behind it up to the length that was asked for. */
static void publish_long(struct publisher *into, const char *text, uint32_t length) {
  uint32_t all = (uint32_t)asked.answer_bytes, before = HEADER + 4;
  uint8_t *bytes = malloc(all + before);
  if (bytes == NULL || all <= length) abort();
  memset(begin(bytes) + 4, '.', all - 1);
  memcpy(bytes + HEADER, &all, sizeof all);
  memcpy(bytes + before, text, length);
  bytes[before + all - 1] = 0;
  publish(into, bytes, before + all);
  free(bytes);
}

static void answer_text(struct subscription *of, uint64_t count) {
  uint8_t bytes[128] = {0};
  char time[32] = "";
  uint64_t at = now;
  if (asked.sim_time)
    snprintf(time, sizeof time, " %llu.%09llu", (unsigned long long)at / 1000000000,
             (unsigned long long)at % 1000000000);
  char *text = (char *)begin(bytes) + 4;
  uint32_t length = (uint32_t)snprintf(text, 100, "%016llx %llu%s",
                                       (unsigned long long)hash(&of->message),
                                       (unsigned long long)count, time) + 1;
  memcpy(bytes + HEADER, &length, sizeof length);
  if (asked.answer_bytes == 0) publish(of->into, bytes, (HEADER + 4 + length + 3) / 4 * 4);
  else publish_long(of->into, text, length - 1);
}

void say(struct publisher *into) {
  uint8_t bytes[64] = {0};
  uint64_t count = into->published;
  char *text = (char *)begin(bytes) + 4;
  uint32_t length = (uint32_t)snprintf(text, 40, "%llu", (unsigned long long)count) + 1;
  memcpy(bytes + HEADER, &length, sizeof length);
  publish(into, bytes, (HEADER + 4 + length + 3) / 4 * 4);
}

/* std_msgs/Header with an empty frame, then 7 doubles: the number of the message is the first. */
static void answer_stamp(struct subscription *of, uint64_t count) {
  uint8_t bytes[HEADER + 16 + 7 * 8] = {0};
  uint8_t *fields = begin(bytes);
  uint32_t stamp[2] = {number_at(&of->message, 0), number_at(&of->message, 4)}, empty = 1;
  double x = (double)count, one = 1;
  memcpy(fields, stamp, sizeof stamp);
  memcpy(fields + 8, &empty, sizeof empty);
  memcpy(fields + 16, &x, sizeof x);
  memcpy(fields + 16 + 6 * 8, &one, sizeof one);
  publish(of->into, bytes, sizeof bytes);
}

/* geometry_msgs/Twist: straight on, faster with each message. */
static void steer(struct subscription *of, uint64_t count) {
  uint8_t bytes[HEADER + 6 * 8] = {0};
  double speed = (double)count / 10;
  memcpy(begin(bytes), &speed, sizeof speed);
  publish(of->into, bytes, sizeof bytes);
}

void sleep_us(uint64_t us) {
  struct timespec delay = {(time_t)(us / 1000000), (long)(us % 1000000) * 1000};
  if (us > 0) clock_nanosleep(CLOCK_MONOTONIC, 0, &delay, NULL);
}

void run_us(uint64_t us) {
  struct timespec begun, time;
  clock_gettime(CLOCK_MONOTONIC, &begun);
  do clock_gettime(CLOCK_MONOTONIC, &time);
  while ((uint64_t)(time.tv_sec - begun.tv_sec) * 1000000 + (uint64_t)time.tv_nsec / 1000 <
         us + (uint64_t)begun.tv_nsec / 1000);
}

static void await_file(const char *path) {
  for (int ms = 0; access(path, F_OK) != 0; ms++) {
    if (ms == 60000) _exit(4);
    sleep_us(1000);
  }
}

void work(struct subscription *of) {
  uint64_t count = of->called + 1;
  sleep_us(asked.delay_us + (count == 1 ? asked.first_us : 0));
  if (asked.die_after > 0 && count == asked.die_after) {
    struct rlimit none = {0, 0};
    setrlimit(RLIMIT_CORE, &none);
    abort();
  }
  if (count == asked.awaits_at) await_file(asked.awaits);
  if (asked.ends_after > 0 && count == asked.ends_after) kill(getpid(), SIGTERM);
  if (asked.leave_after > 0 && count == asked.leave_after) life_turns();
  bool dropped = asked.drop_every > 0 && count % asked.drop_every == 0;
  if (of->message.length < asked.answers_from) dropped = true;
  for (uint64_t answer = 0; answer < asked.answers && !dropped; answer++) {
    if (of->work == WORK_TEXT) answer_text(of, count);
    if (of->work == WORK_STAMP) answer_stamp(of, count);
    if (of->work == WORK_STEER) steer(of, count);
  }
  of->called = count;
}
