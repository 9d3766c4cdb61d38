/* librmw_implementation.so of a script: its rmw_wait sleeps never, and the clock of its process
 * goes on by what each wait would have lasted. */
#define _GNU_SOURCE
#include "script.h"

#include <stdio.h>
#include <string.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

static struct script script;
static struct seen seen;
static uint64_t clock_now = 7 * 1000000000ull;

/* In front of the C library's, for this program and what is preloaded into it. */
int clock_gettime(clockid_t which, struct timespec *time) {
  if (which != CLOCK_MONOTONIC) return (int)syscall(SYS_clock_gettime, which, time);
  time->tv_sec = (time_t)(clock_now / 1000000000ull);
  time->tv_nsec = (long)(clock_now % 1000000000ull);
  return 0;
}

uint64_t script_clock(void) { return clock_now; }

void script_run(const struct script *of) {
  script = *of;
  memset(&seen, 0, sizeof seen);
}

const struct seen *script_seen(void) { return &seen; }

void *rmw_create_subscription(const void *node, const void *type, const char *topic,
                              const struct qos *qos, const void *options) {
  (void)node, (void)type, (void)topic, (void)qos, (void)options;
  static const void *subscription[2]; /* as its handle begins, for the first thing that is waited for */
  subscription[1] = THING(0, 0);
  return subscription;
}

int rmw_subscription_count_matched_publishers(const void *subscription, size_t *publishers) {
  (void)subscription;
  *publishers = (size_t)++seen.samples;
  return script.refuse != 0 && seen.samples >= script.refuse;
}

static bool is_whole(struct set **sets) {
  for (uint64_t set = 0; set < SETS; set++)
    for (uint64_t thing = 0; sets[set] != NULL && thing < sets[set]->count; thing++)
      if (sets[set]->subscribers[thing] != THING(set, thing)) return false;
  return true;
}

static void clear(struct set **sets) {
  for (uint64_t set = 0; set < SETS; set++)
    for (uint64_t thing = 0; sets[set] != NULL && thing < sets[set]->count; thing++)
      sets[set]->subscribers[thing] = NULL;
}

int rmw_wait(struct set *subscriptions, struct set *guards, void *services, void *clients, void *events,
             void *wait_set, const struct span *timeout) {
  (void)wait_set;
  struct set *sets[SETS] = {subscriptions, guards, services, clients, events};
  uint64_t length =
      timeout == NULL ? UINT64_MAX : timeout->seconds * 1000000000ull + timeout->nanoseconds;
  char line[16];
  if (++seen.calls == script.pause_at) {
    printf("paused\n");
    if (fgets(line, sizeof line, stdin) == NULL) return 1;
  }
  seen.spoilt += !is_whole(sets);
  seen.last = length;
  if (length != UINT64_MAX && seen.longest < length) seen.longest = length;
  clear(sets);
  bool acts = seen.calls == script.act_at || timeout == NULL;
  if (timeout != NULL && !(acts && script.result == 0)) clock_now += length + script.late;
  if (!acts) return 2;
  if (script.set >= 0)
    sets[script.set]->subscribers[script.index] = THING((uint64_t)script.set, script.index);
  return script.result;
}
