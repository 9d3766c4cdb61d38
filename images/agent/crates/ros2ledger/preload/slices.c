#include "slices.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "count.h"
#include "matches.h"

#define RMW_OK 0
#define RMW_TIMEOUT 2
#define SECOND 1000000000ull
#define SLICE (SECOND / 50)
#define ENDLESS UINT64_MAX
/* Things that are kept on the stack, and at all: a wait for more is one call, not sampled within. */
#define FEW 64u
#define MOST 65536u

/* In nanoseconds, of which 64 bits have 584 years: longer than that is ENDLESS. */
static uint64_t length(const struct span *timeout) {
  uint64_t seconds, both;
  if (timeout == NULL || __builtin_mul_overflow(timeout->seconds, SECOND, &seconds) ||
      __builtin_add_overflow(seconds, timeout->nanoseconds, &both))
    return ENDLESS;
  return both;
}

static uint64_t now(void) {
  struct timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return (uint64_t)time.tv_sec * SECOND + (uint64_t)time.tv_nsec;
}

static int call(const struct wait *wait, uint64_t nanoseconds) {
  struct span span = {nanoseconds / SECOND, nanoseconds % SECOND};
  return wait->next(wait->set[0], wait->set[1], wait->set[2], wait->set[3], wait->set[4],
                    wait->wait_set, nanoseconds == ENDLESS ? NULL : &span);
}

static size_t things(const struct set *set) {
  return set == NULL || set->things == NULL ? 0 : set->count;
}

/* More than MOST where it would not fit. */
static size_t all_things(const struct wait *wait) {
  size_t all = 0;
  for (int one = 0; one < SETS; one++) {
    size_t more = things(wait->set[one]);
    all = more > MOST ? MOST + 1 : all + more;
    if (all > MOST) return all;
  }
  return all;
}

static void keep(const struct wait *wait, void **room) {
  for (int one = 0; one < SETS; one++) {
    size_t many = things(wait->set[one]);
    if (many > 0) memcpy(room, wait->set[one]->things, many * sizeof *room);
    room += many;
  }
}

static void restore(const struct wait *wait, void *const *room) {
  for (int one = 0; one < SETS; one++) {
    size_t many = things(wait->set[one]);
    if (many > 0) memcpy(wait->set[one]->things, room, many * sizeof *room);
    room += many;
  }
}

static bool is_ready(const struct wait *wait) {
  for (int one = 0; one < SETS; one++) {
    for (size_t thing = 0; thing < things(wait->set[one]); thing++)
      if (wait->set[one]->things[thing] != NULL) return true;
  }
  return false;
}

/* The subscriptions come first in the room. */
static void note_rest(const struct wait *wait, void *const *room, uint64_t begun) {
  for (size_t one = 0; one < things(wait->set[0]); one++)
    if (wait->set[0]->things[one] == NULL) count_rest(room[one], begun);
}

/* Waits once, and notes what had nothing to take. */
static int slice(const struct wait *wait, void *const *room, uint64_t nanoseconds) {
  uint64_t begun = count_moment();
  int result = call(wait, nanoseconds);
  if (result == RMW_OK || result == RMW_TIMEOUT) note_rest(wait, room, begun);
  return result;
}

static int slices(const struct wait *wait, void **room) {
  uint64_t limit = length(wait->timeout), began = now(), left = limit;
  keep(wait, room);
  /* Of a topic on which something comes more often than a slice ends, only a look that does not
   * wait sees that nothing is left. */
  uint64_t next = 0;
  for (;;) {
    bool last = left <= next || matches_watched() == 0;
    int result = slice(wait, room, last ? left : next);
    if (last || result != RMW_TIMEOUT) return result;
    /* It came between the slice's end and the look at what is ready, and is reported only once:
     * in one call that is no timeout. */
    if (is_ready(wait)) return RMW_OK;
    restore(wait, room);
    if (next > 0) matches_sample();
    uint64_t passed = now() - began;
    if (limit != ENDLESS) left = passed < limit ? limit - passed : 0;
    next = SLICE;
  }
}

int wait_in_slices(const struct wait *wait) {
  void *few[FEW];
  size_t many = all_things(wait);
  matches_sample();
  void **room = many <= FEW ? few : many <= MOST ? malloc(many * sizeof *room) : NULL;
  if (room == NULL) return call(wait, length(wait->timeout));
  int result = slices(wait, room);
  if (room != few) free(room);
  return result;
}
